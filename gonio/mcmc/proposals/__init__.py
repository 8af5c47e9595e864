"""Proposals, one a file.

A proposal works in coordinates `u` of its own, (n, chains). It offers

    uniforms, normals           how many random numbers one step takes
    propose(u, uniform, normal) -> u_new, kind
                                 symmetric in u: the density of going there equals that of coming back; u = None
                                 where the chain has no state yet
    to_directions(u)             -> wi, wo, (N, 3)
    from_directions(wi, wo)      -> u, its inverse up to the symmetries of the surface
    log_jacobian(u)              log |d(wi, wo) / du|, solid angles (isotropic: up to a constant)
    place(u)                     -> wi, wo, log_jacobian, at the price of one

so that a move is accepted with min(1, W(u_new) / W(u)), W = p(wi, wo) |d(wi, wo) / du| (METHOD 2). A proposal that
does not depend on where the chain is offers, instead of `propose` and `place`,

    draw_block(uniform)          -> u, wi, wo, log_jacobian of up to `block` steps of all chains

Its coordinates are the directions themselves and its `log_jacobian` is -log q: the same formula then is the ratio of
importance weights. `kind` (N,) says for the log what each move was;
drawn and fill are measurements that are no step (gonio.mcmc.plans.unknown): with a density, without one; imported was
measured elsewhere and asked by nobody here; listed ones were given by hand (gonio.mcmc.listed).
"""

LOCAL, GLOBAL, INDEPENDENCE, PILOT, DRAWN, FILL, IMPORTED, LISTED = range(8)
KINDS = ("local", "global", "independence", "pilot", "drawn", "fill", "imported", "listed")
