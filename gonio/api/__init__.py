"""What a notebook calls: each of these names is also in `gonio` itself. It computes nothing that is not below it."""
