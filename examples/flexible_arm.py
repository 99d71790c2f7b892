"""A UR5 with elastic upper arm and forearm: what a payload does to its lowest frequency.

The arm is soft at its first bending mode; 5 kg at the tool lower it.
"""

import dataclasses

import pinflex as pf
from pinflex.description.blocks.flexible import EndMass


def main() -> float:
    robot = pf.load("ur5")
    forearm = next(link for link in robot.description.flexible if link.link == "forearm_link")
    others = tuple(link for link in robot.description.flexible if link is not forearm)
    loaded = dataclasses.replace(forearm, tip=EndMass(5.0))
    heavy = pf.load(robot.description.replace(flexible=(*others, loaded)))
    bare = float(pf.modes(robot, count=1).frequencies[0])
    with_payload = float(pf.modes(heavy, count=1).frequencies[0])
    print(f"lowest frequency {bare:.1f} Hz, with 5 kg at the wrist {with_payload:.1f} Hz")
    # Adding mass can only lower a natural frequency (Rayleigh).
    assert with_payload < bare
    return with_payload


if __name__ == "__main__":
    main()
