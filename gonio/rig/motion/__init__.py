"""Where the axes may go, by which way, in which order, and how long it takes."""
