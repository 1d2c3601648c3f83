"""Three plants of judged.rs, solved by SciPy, with their equations written again by hand.

In: the name of a plant, and on standard input the instant of each row. Out: a line for each row with the outputs, in the order of the text.
"""

import sys

import numpy as np
from scipy.integrate import solve_ivp


def rows(time, start, rates, method, outputs, event=None):
    """Solves from row to row with constant inputs. After an event the other law applies."""
    state, law = np.array(start), 0
    print(*(repr(float(it)) for it in outputs(time[0], state)))
    for begin, end in zip(time[:-1], time[1:]):
        now = begin
        while now < end:
            crossing = None
            if event is not None:
                crossing = lambda t, x: event(x)
                crossing.terminal = True
                crossing.direction = 1 if law == 0 else -1
            found = solve_ivp(lambda t, x: rates(begin, x, law), (now, end), state, method, rtol=1e-12, atol=1e-14, events=crossing)
            if not found.success:
                sys.exit(found.message)
            now, state = found.t[-1], found.y[:, -1]
            if found.status == 1:
                law = 1 - law
        print(*(repr(float(it)) for it in outputs(end, state)))


def driveline(time):
    gear, last, r, m = 2.2, 3.7, 0.32, 1560.0

    def wanted(t, w):
        return (0.1 if t < 0.05 else 0.6) * (120.0 + 0.6 * w - 0.001 * w**2)

    def wheel(x):
        pull = 5000.0 * (x[3] / last - x[5]) + 65.0 * (x[4] / last - x[6])
        road = m * 0.0980665 + 0.5 * 0.81 * 1.2 * (r * x[6]) ** 2
        return pull, (pull - 0.1 * x[6] - r * road) / (1.0 + m * r**2)

    def rates(t, x, _):
        clutch = 1e4 * (x[1] - gear * x[3]) + 30.0 * (x[2] - gear * x[4])
        pull, gained = wheel(x)
        shaft = gear * clutch - (0.1 + 0.1 / last**2) * x[4] - pull / last
        return [
            (wanted(t, x[2]) - x[0]) / 0.1,
            x[2],
            (x[0] - 15.0 - 0.03 * x[2] - clutch) / 0.17,
            x[4],
            shaft / (0.014 + 0.031 / last**2),
            x[6],
            gained,
        ]

    w = 8.0 / r
    w_e = gear * last * w
    torque = wanted(0.0, w_e)
    clutch = torque - 15.0 - 0.03 * w_e
    start = [torque, clutch / 1e4, w_e, 0.0, last * w, -gear * last * clutch / 5000.0, w]
    rows(time, start, rates, "Radau", lambda t, x: (x[2], r * x[6], r * wheel(x)[1]))


def cylinder(time):
    def rates(t, x, _):
        valve = lambda drop: 2e-7 * (0.0 if t < 0.02 else 0.3) * np.sign(drop) * np.sqrt(abs(drop))
        a, b, position, speed = x
        return [
            1.2e9 * (valve(1e7 - a) - 1e-3 * speed) / (5e-4 + 1e-3 * position),
            1.2e9 * (1e-3 * speed - valve(b)) / (5e-4 - 1e-3 * position),
            speed,
            (1e-3 * (a - b) - 800.0 * speed - 20000.0 * position) / 50.0,
        ]

    rows(time, [2e6, 2e6, 0.0, 0.0], rates, "DOP853", lambda t, x: (x[2],))


def tank(time):
    def rates(t, x, law):
        over = 3.0 * (x[0] - 1.0) if law == 1 else 0.0
        return [((0.03 if t < 40.0 else 0.005) - 0.02 * x[0] - over) / 0.5]

    rows(time, [0.2], rates, "DOP853", lambda t, x: (x[0],), event=lambda x: x[0] - 1.0)


{"driveline": driveline, "cylinder": cylinder, "tank": tank}[sys.argv[1]]([float(line) for line in sys.stdin])
