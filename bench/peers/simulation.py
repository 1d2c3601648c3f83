"""Other solvers on the plants of the benchmark: SciPy's LSODA with rates compiled by numba, and diffsol with DiffSL.

In: a JSON file of plants, each with its parameters, the states at the start, the instants and inputs of its rows, the outputs at a tolerance of 1e-13, a tolerance.
Out: JSON: by plant and solver, rows a second in the shortest of some runs, and the largest error of an output as a share of its size.

Inputs hold from row to row. A solver is called once for every stretch of rows with the same inputs, so a step of an input is a restart and never lies inside of a step.
"""

import json
import sys
import time

import numpy as np
import pydiffsol
from numba import njit
from scipy.integrate import odeint

RUNS = 3


@njit
def motor(x, t, p, u):
    r, l, flux, poles, inertia, friction = p
    w = poles * x[2]
    return np.array([
        (u[0] - r * x[0] + w * l * x[1]) / l,
        (u[1] - r * x[1] - w * (l * x[0] + flux)) / l,
        (1.5 * poles * flux * x[1] - friction * x[2] - u[2]) / inertia,
    ])


MOTOR = """
in_i {{ vd = 0, vq = 0, load = 0, d0 = 0, q0 = 0, w0 = 0 }}
u_i {{ d = d0, q = q0, w = w0 }}
F_i {{
  (vd - {0} * d + {3} * w * {1} * q) / {1},
  (vq - {0} * q - {3} * w * ({1} * d + {2})) / {1},
  (1.5 * {3} * {2} * q - {5} * w - load) / {4},
}}
"""


@njit
def car(x, t, p, u):
    (engine, gear, final, inertia_1, inertia_2, k_c, c_c, k_s, c_s, c_1, c_2, mass, radius, roll_1, roll_2, area, air, t_0, t_1, t_2, lag, f_0, f_1) = p
    torque, speed, angle, shaft, shaft_speed, wheel, wheel_speed = x
    clutch = k_c * (angle - gear * shaft) + c_c * (speed - gear * shaft_speed)
    drive = k_s * (shaft / final - wheel) + c_s * (shaft_speed / final - wheel_speed)
    resistance = mass * (roll_1 + roll_2 * wheel_speed) + 0.5 * area * air * (radius * wheel_speed) ** 2
    return np.array([
        (u[0] * (t_0 + t_1 * speed + t_2 * speed**2) - torque) / lag,
        (torque - f_0 - f_1 * speed - clutch) / engine,
        speed,
        shaft_speed,
        (gear * clutch - c_1 * shaft_speed - drive / final) / inertia_1,
        wheel_speed,
        (drive - c_2 * wheel_speed - radius * resistance) / inertia_2,
    ])


CAR = """
in_i {{ pedal = 0, x0 = 0, x1 = 0, x2 = 0, x3 = 0, x4 = 0, x5 = 0, x6 = 0 }}
u_i {{ torque = x0, speed = x1, angle = x2, shaft = x3, shaftspeed = x4, wheel = x5, wheelspeed = x6 }}
clutch {{ {5} * (angle - {1} * shaft) + {6} * (speed - {1} * shaftspeed) }}
drive {{ {7} * (shaft / {2} - wheel) + {8} * (shaftspeed / {2} - wheelspeed) }}
resistance {{ {11} * ({13} + {14} * wheelspeed) + 0.5 * {15} * {16} * {12} * wheelspeed * {12} * wheelspeed }}
F_i {{
  (pedal * ({17} + {18} * speed + ({19}) * speed * speed) - torque) / {20},
  (torque - {21} - {22} * speed - clutch) / {0},
  speed,
  shaftspeed,
  ({1} * clutch - {9} * shaftspeed - drive / {2}) / {3},
  wheelspeed,
  (drive - {10} * wheelspeed - {12} * resistance) / {4},
}}
"""


@njit
def slider(x, t, p, u):
    mass, gain, friction = p[0], p[1], p[2]
    return np.array([x[1], (gain * u[0] - friction * x[1]) / mass])


SLIDER = """
in_i {{ command = 0, x0 = 0, v0 = 0 }}
u_i {{ x = x0, v = v0 }}
F_i {{ v, ({1} * command - {2} * v) / {0} }}
"""


def of_motor(p):
    names = ["phase_resistance", "phase_inductance", "flux_linkage", "pole_pairs", "inertia", "viscous_friction"]
    return [p[name] for name in names], ["current_d", "current_q", "speed"], ["v_d", "v_q", "load_torque"], {"i_d": (0, 1), "i_q": (1, 1), "speed": (2, 1)}


def of_car(p):
    gear, final = p["gear_ratios[3]"], p["final_drive_ratio"]
    inertia_1 = p["transmission_inertia"] + p["final_drive_inertia"] / final**2
    inertia_2 = p["wheel_inertia"] + p["mass"] * p["wheel_radius"] ** 2
    c_1 = p["transmission_damping"] + p["final_drive_damping"] / final**2
    values = [p["engine_inertia"], gear, final, inertia_1, inertia_2, p["clutch_stiffness"], p["clutch_damping"], p["driveshaft_stiffness"], p["driveshaft_damping"], c_1, p["wheel_damping"], p["mass"], p["wheel_radius"], p["rolling_resistance_1"], p["rolling_resistance_2"], p["drag_area"], p["air_density"], p["torque_0"], p["torque_1"], p["torque_2"], p["torque_lag"], p["engine_friction_0"], p["engine_friction_1"]]
    states = ["engine_torque", "engine_speed", "engine_angle", "shaft_angle", "shaft_speed", "wheel_angle", "wheel_speed"]
    return values, states, ["throttle"], {"engine_speed": (1, 1), "road_speed": (6, p["wheel_radius"])}


def of_slider(p):
    return [p["mass"], p["force_gain"], p["viscous_friction"]], ["position", "speed"], ["reference"], {"position": (0, 1)}


class Controller:
    """The position controller of the axis, which samples at every row."""

    def __init__(self, p, position):
        self.p, self.now, self.before = p, position, position

    def command(self, reference, position):
        long_before, self.before, self.now = self.before, self.now, position
        seen = (self.now - long_before) / (2 * self.p["record_period"])
        limit = self.p["command_limit"]
        return max(-limit, min(limit, self.p["velocity_gain"] * (self.p["position_gain"] * (reference - position) - seen)))


PLANTS = {"pmac": (motor, MOTOR, of_motor), "driveline": (car, CAR, of_car), "servo-axis": (slider, SLIDER, of_slider)}


def along(plant, of, solve):
    """The states at every row. `solve` gives the states at the instants of a stretch, the first of which is its start."""
    _, states, names, _ = of(plant["parameters"])
    instants = np.array(plant["time"])
    inputs = np.array([plant["inputs"][name] for name in names]).T
    controller = Controller(plant["parameters"], plant["states"]["position"]) if states[0] == "position" else None
    x = np.array([plant["states"][name] for name in states])
    found = np.empty((len(instants), len(x)))
    found[0] = x
    begin = 0
    while begin < len(instants) - 1:
        end = begin + 1
        held = inputs[begin]
        if controller:
            held = np.array([controller.command(held[0], x[0])])
        else:
            while end < len(instants) - 1 and (inputs[end] == held).all():
                end += 1
        part = solve(x, instants[begin : end + 1] - instants[begin], held)
        found[begin + 1 : end + 1] = part[1:]
        x, begin = part[-1], end
    return found


def error(plant, of, found):
    worst = 0.0
    for name, (place, factor) in of(plant["parameters"])[3].items():
        reference = np.array(plant["reference"][name])
        worst = max(worst, np.abs(found[:, place] * factor - reference).max() / np.abs(reference).max())
    return worst


def measured(plant, of, solve):
    found = along(plant, of, solve)  # compiles
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        found = along(plant, of, solve)
        seconds.append(time.perf_counter() - start)
    return {"rows_per_second": len(found) / min(seconds), "error": error(plant, of, found)}


def main():
    answers = {}
    for name, plant in json.load(open(sys.argv[1])).items():
        rates, text, of = PLANTS[name]
        values = of(plant["parameters"])[0]
        p, tolerance = np.array(values), plant["tolerance"]

        def lsoda(x, instants, held):
            return odeint(rates, x, instants, args=(p, held), rtol=tolerance, atol=tolerance * 1e-3)

        answer = {"lsoda": measured(plant, of, lsoda)}
        best = None
        for method in (pydiffsol.tsit45, pydiffsol.bdf, pydiffsol.esdirk34, pydiffsol.tr_bdf2):
            ode = pydiffsol.Ode(text.format(*values), matrix_type=pydiffsol.nalgebra_dense, ode_solver=method)
            ode.rtol, ode.atol = tolerance, tolerance * 1e-3
            ode.h0 = 0.1 * (plant["time"][1] - plant["time"][0])

            def diffsol(x, instants, held):
                start = np.concatenate([held, x])
                if len(instants) == 2:  # rounding at the end of so short a way makes solve_dense panic
                    return np.vstack([x, ode.solve(start, instants[1]).ys[:, -1]])
                return ode.solve_dense(start, instants).ys.T

            try:
                found = measured(plant, of, diffsol) | {"method": str(method).split(".")[-1]}
            except BaseException as failed:  # a panic of the solver is no Exception; a method that cannot take the plant is not the best
                print(f"{name}, {method}: {failed}", file=sys.stderr)
                continue
            if best is None or found["rows_per_second"] > best["rows_per_second"]:
                best = found
        answer["diffsol"] = best
        answers[name] = answer
    print(json.dumps(answers))


main()
