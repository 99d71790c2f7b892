"""Which level, links, planes, modes and tolerance a scene needs; error bars."""
