"""What `auto` is made of: a robust base, and splines of the log ratio to it in coordinates that samples choose."""
