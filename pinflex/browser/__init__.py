"""A page that computes: the kernel as WebAssembly, and a scene as it needs it."""
