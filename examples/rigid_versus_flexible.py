"""How far off are rigid torques? The 3-RRR on its 60 mm circle at 5 turns a second.

The largest rigid torque is 10.83 N m (Newton-Euler); the flexible links add vibration around it.
"""

import pinflex as pf


def main() -> float:
    robot = pf.load("3rrr")
    rigid = pf.solve(robot, level="rigid")
    flexible = pf.solve(robot, level="coupled")
    print(pf.comparison(rigid, {"coupled": flexible}).text())
    largest = float(abs(rigid.joint("motor_2").torque).max())
    # 0.5 %: the samples need not hit the peak itself.
    assert abs(largest - 10.83) < 0.005 * 10.83
    return largest


if __name__ == "__main__":
    main()
