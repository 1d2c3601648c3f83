//! Proves whether the current references of the motor's loop keep the limits (20), for a whole box of operating points.
//!
//! In: the two surfaces of the loop, a nominal plant, the box: every torque demand, speeds of both directions up to a top speed, bus voltages. Out: a
//! proof that in steady state at these references |v| <= V/sqrt 3 and |i| <= I, with the largest share of each limit; or a point of the box where one
//! does not hold, checked in exact rationals; or, if the limit of work is reached, the cell that is not decided. There is no tolerance: the
//! references are the bits that the step computes in f32 (`step.rs` encloses them; a test compares it with the target). The voltages (17), (18) at
//! these references are enclosed as real numbers, at the sampled speed and bus voltage.
//!
//! ```text
//! |v|^2 = (r i_d - w_e L i_q)^2 + (r i_q + w_e (L i_d + lambda))^2,   w_e = pole_pairs w
//! ```
//!
//! The search is branch and bound over three numbers: the scaled speed s at which the surfaces are evaluated, the bus voltage V, and the wanted i_q.
//! The wanted i_q represents every torque demand and every torque of the last tick, because they act only through it. Divided by V, the voltage
//! depends on w/V = s/V_nominal, and on V itself only through the small resistive drop. So cells may be long in V. Step and motor are symmetric in
//! the direction of rotation, so only forward speeds are searched.

pub mod range;
pub mod step;

use rsm_core::order;
use std::collections::BinaryHeap;

use rsm_core::check::Checked;
use rsm_core::interval::Interval;
use rsm_core::number::{Rational, exact, integer};
use rsm_core::source::Faults;

use range::Range;
use rsm_sim::plant_file::Parameters;
use step::{Constants, Step, Tapes};

/// The box of a proof, beside the torque demand, which may be any number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operation {
    /// The highest speed of either direction, in mechanical rad/s.
    pub top_speed_rad_s: f32,
    /// The lowest and the highest bus voltage, in V.
    pub bus_voltage_v: [f32; 2],
    /// The most that the feedback of the voltage may add to the weakening current, in A.
    pub trim_a: f32,
}

/// The number of cells that a search may examine before it gives up: some seconds.
pub const WORK: usize = 3_000_000;

/// After its proof a search continues until the upper bound of the largest share is this close to the largest share that was seen, because the share
/// is reported; or until it has examined [`WORK_FOR_THE_SHARE`] cells.
const CLOSE: f64 = 1e-3;
const WORK_FOR_THE_SHARE: usize = 100_000;

/// A point of the box: samples and state of a tick, and what the step gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// The torque demand, in N m.
    pub torque_nm: f32,
    /// The speed, in rad/s.
    pub speed_rad_s: f32,
    /// The bus voltage, in V.
    pub bus_voltage_v: f32,
    /// The torque of the references of the tick before, in N m.
    pub last_torque_nm: f32,
    /// What the feedback of the voltage adds to the weakening current, in A.
    pub trim_a: f32,
    /// i_d of the references, in A.
    pub i_d_a: f32,
    /// i_q of the references, in A.
    pub i_q_a: f32,
}

/// The result for one limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// No point of the box takes a larger share of the limit.
    pub at_most: f64,
    /// The largest share that was seen.
    pub seen: f64,
    /// The point of `seen`.
    pub at: Point,
}

/// A cell of the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Wanted torque, in N m: the demand within the available torque.
    pub torque_nm: [f64; 2],
    /// Speeds that may be in it, in rad/s.
    pub speed_rad_s: [f64; 2],
    /// Bus voltages, in V.
    pub bus_voltage_v: [f64; 2],
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// Both limits hold over the whole box.
    Proved,
    /// The voltage limit does not hold at this point, exactly.
    VoltageExceeded(Point),
    /// The current limit does not hold at this point, exactly.
    CurrentExceeded(Point),
    /// The limit of work is reached, and this cell is the worst of those that are left.
    Undecided(Cell),
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// The answer.
    pub verdict: Verdict,
    /// |v| over V/sqrt 3.
    pub voltage: Share,
    /// |i| over I.
    pub current: Share,
    /// Cells that were examined.
    pub cells: usize,
}

/// Searches the box, with at most `work` cells.
///
/// # Errors
/// A model without the surfaces of the loop, or in other units, or beyond f32.
///
/// # Panics
/// When the parameters are not those of a `pmac` plant.
pub fn prove(model: &Checked, parameters: &Parameters, operation: &Operation, work: usize) -> Result<Limits, Faults> {
    let tapes = Tapes::new(model)?;
    let step = Step::new(Constants::new(parameters), &tapes);
    let [least_bus, _] = operation.bus_voltage_v;
    let whole_speed = step.circle_speed(Range::point(operation.top_speed_rad_s), Range::point(least_bus)).high;
    Ok(Search { step, motor: Motor::new(parameters), operation: *operation, whole_speed }.run(work))
}

/// The parameters of (17), (18), (20), exactly.
struct Motor {
    resistance: f64,
    inductance: f64,
    flux_linkage: f64,
    pole_pairs: f64,
    current_limit: f64,
}

impl Motor {
    fn new(parameters: &Parameters) -> Self {
        Motor {
            resistance: parameters.number("phase_resistance"),
            inductance: parameters.number("phase_inductance"),
            flux_linkage: parameters.number("flux_linkage"),
            pole_pairs: parameters.number("pole_pairs"),
            current_limit: parameters.number("current_limit"),
        }
    }

    /// 3 |v|^2 / V^2 and |i|^2 / I^2 at a point, exactly.
    fn squares(&self, point: &Point) -> [Rational; 2] {
        let of = |value: f32| exact(f64::from(value));
        let (i_d, i_q, bus) = (of(point.i_d_a), of(point.i_q_a), of(point.bus_voltage_v));
        let w_e = exact(self.pole_pairs) * of(point.speed_rad_s);
        let [r, l, lambda, limit] = [self.resistance, self.inductance, self.flux_linkage, self.current_limit].map(exact);
        let v_d = &r * &i_d - &w_e * &l * &i_q;
        let v_q = &r * &i_q + &w_e * (&l * &i_d + lambda);
        let voltage = integer(3) * (&v_d * &v_d + &v_q * &v_q) / (&bus * &bus);
        [voltage, (&i_d * &i_d + &i_q * &i_q) / (&limit * &limit)]
    }

    /// The same in f64, to choose by.
    fn rough_squares(&self, point: &Point) -> [f64; 2] {
        let of = |value: f32| f64::from(value);
        let (i_d, i_q, w_e) = (of(point.i_d_a), of(point.i_q_a), self.pole_pairs * of(point.speed_rad_s));
        let v_d = self.resistance * i_d - w_e * self.inductance * i_q;
        let v_q = self.resistance * i_q + w_e * (self.inductance * i_d + self.flux_linkage);
        let bus = of(point.bus_voltage_v);
        [3.0 * (v_d * v_d + v_q * v_q) / (bus * bus), (i_d * i_d + i_q * i_q) / (self.current_limit * self.current_limit)]
    }
}

/// A cell of the search.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// The scaled speed s as the step computes it.
    circle_speed: Range,
    bus_voltage: Range,
    /// The wanted i_q.
    wanted: Range,
    /// What the feedback of the voltage adds.
    trim: Range,
    /// No point of it has a larger 3 |v|^2 / V^2.
    bound: f64,
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Part {}
impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Part {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// s is |w| (V_nominal/V) with two roundings of at most 2^-24 each (1 + 2^-22.99 in all), and at most 2^-149 where it is subnormal.
const SCALING: f64 = 1.3e-7;
const SUBNORMAL: f64 = 1e-44;

/// Weight of the bus voltage relative to the speed when a cell is halved: r I is a thirtieth of V/sqrt 3 in a motor of some kilowatts.
const BUS_WEIGHT: f32 = 0.05;

/// The same for the trim: it only increases the weakening.
const TRIM_WEIGHT: f32 = 0.25;

struct Search<'t> {
    step: Step<'t>,
    motor: Motor,
    operation: Operation,
    /// The highest scaled speed.
    whole_speed: f32,
}

impl Search<'_> {
    fn run(mut self, work: usize) -> Limits {
        let nowhere = Share { at_most: 0.0, seen: 0.0, at: self.tick(0.0, 0.0, self.operation.bus_voltage_v[0], 0.0, 0.0) };
        let (mut voltage, mut current) = (nowhere, nowhere);
        let mut cells = 0;
        let current_left = self.current(work, &mut current, &mut cells);
        let voltage_left = self.voltage(work, &mut voltage, &mut current, &mut cells);
        let [voltage_breaks, _] = self.motor.squares(&voltage.at).map(|square| square > integer(1));
        let [_, current_breaks] = self.motor.squares(&current.at).map(|square| square > integer(1));
        let verdict = if voltage_breaks {
            Verdict::VoltageExceeded(voltage.at)
        } else if current_breaks {
            Verdict::CurrentExceeded(current.at)
        } else {
            voltage_left.or(current_left).map_or(Verdict::Proved, Verdict::Undecided)
        };
        Limits { verdict, voltage, current, cells }
    }

    /// One tick of the step, for a motor that turns forwards.
    fn tick(&mut self, torque: f32, speed: f32, bus_voltage: f32, last_torque: f32, trim: f32) -> Point {
        let circle_speed = self.step.circle_speed(Range::point(speed), Range::point(bus_voltage));
        let wanted = self.step.wanted(Range::point(torque), Range::point(last_torque), circle_speed);
        let found = self.step.currents(wanted, circle_speed, Range::point(trim));
        Point {
            torque_nm: torque,
            speed_rad_s: speed,
            bus_voltage_v: bus_voltage,
            last_torque_nm: last_torque,
            trim_a: trim,
            i_d_a: found.i_d.low,
            i_q_a: found.i_q.low,
        }
    }

    /// |i| <= I: whatever the surfaces give, i_q is limited to the current circle at i_d. So the search is over one number, i_d.
    fn current(&mut self, work: usize, share: &mut Share, cells: &mut usize) -> Option<Cell> {
        let limit = self.motor.current_limit;
        let whole = Range::ends(-self.step.most_weakening(), 0.0);
        let mut worst = 0.0f64;
        let mut left = vec![whole];
        while let Some(i_d) = left.pop() {
            *cells += 1;
            let most = self.step.most_beside(i_d);
            // With a negative bound the ends of `within(wanted, -most, most)` are exchanged; its magnitude counts.
            let i_q = most.low.abs().max(most.high.abs());
            let square = squared(i_d.reals()) + squared(Interval::point(f64::from(i_q)));
            let bound = square.high / (limit * limit).next_down();
            if bound.next_up() <= 1.0 {
                worst = worst.max(bound.next_up());
                continue;
            }
            match i_d.halves() {
                Some(halves) if *cells < work => left.extend(halves),
                _ => {
                    share.at_most = f64::INFINITY;
                    let all = self.step.constants.newton_metres_per_ampere * self.step.constants.current_limit_a;
                    let bus = self.operation.bus_voltage_v.map(f64::from);
                    let top = f64::from(self.operation.top_speed_rad_s);
                    return Some(Cell {
                        torque_nm: [-f64::from(all), f64::from(all)],
                        speed_rad_s: [0.0, top],
                        bus_voltage_v: bus,
                    });
                }
            }
        }
        share.at_most = worst.sqrt().next_up();
        None
    }

    /// |v| <= V/sqrt 3.
    fn voltage(&mut self, work: usize, share: &mut Share, current: &mut Share, cells: &mut usize) -> Option<Cell> {
        let [bus_low, bus_high] = self.operation.bus_voltage_v;
        let bus = Range::ends(bus_low, bus_high);
        let limit = self.step.constants.current_limit_a;
        let all_speeds = Range::ends(0.0, self.operation.top_speed_rad_s);
        let root = Part {
            circle_speed: self.step.circle_speed(all_speeds, bus),
            bus_voltage: bus,
            wanted: Range::ends(-limit, limit),
            trim: Range::ends(0.0, self.operation.trim_a),
            bound: f64::INFINITY,
        };
        let mut queue = BinaryHeap::new();
        queue.extend(self.bounded(root));
        let mut seen = 0.0f64;
        share.at_most = 0.0;
        // The bound of finished cells that are as narrow as rounding.
        let mut finest = 0.0f64;
        while let Some(part) = queue.pop() {
            *cells += 1;
            let bound = part.bound.max(finest);
            share.at_most = bound.sqrt().next_up();
            let is_close = share.at_most - share.seen <= CLOSE;
            let is_told = is_close || *cells > WORK_FOR_THE_SHARE;
            // Proved or broken: in both cases the search ends when the share is close, or after enough work.
            if (bound <= 1.0 || seen > 1.0) && is_told {
                break;
            }
            if *cells > work {
                return Some(self.named(&part));
            }
            for point in self.ticks(&part) {
                let [of_voltage, of_current] = self.motor.rough_squares(&point);
                if of_voltage > seen {
                    seen = of_voltage;
                    (share.seen, share.at) = (of_voltage.sqrt(), point);
                }
                if of_current.sqrt() > current.seen {
                    (current.seen, current.at) = (of_current.sqrt(), point);
                }
            }
            match self.cut(&part) {
                Some(halves) => queue.extend(halves),
                // A cell of neighbouring numbers cannot be halved.
                None if part.bound > 1.0 && seen <= 1.0 => return Some(self.named(&part)),
                None => finest = finest.max(part.bound),
            }
        }
        share.at_most = share.at_most.max(finest.sqrt().next_up()).max(share.seen);
        None
    }

    /// Ticks in the middle of a cell.
    fn ticks(&mut self, part: &Part) -> Vec<Point> {
        let constants = self.step.constants;
        let bus = part.bus_voltage.middle();
        let speed = part.circle_speed.middle() * (bus / constants.nominal_bus_v);
        let torque = constants.newton_metres_per_ampere * part.wanted.middle();
        let trim = part.trim.middle();
        let all = constants.newton_metres_per_ampere * constants.current_limit_a;
        let speed = speed.min(self.operation.top_speed_rad_s);
        [-all, torque, all].map(|last| self.tick(torque, speed, bus, last, trim)).to_vec()
    }

    /// The cell without the points that are impossible, with its bound; `None` if no point is left.
    fn bounded(&mut self, mut part: Part) -> Option<Part> {
        let constants = self.step.constants;
        let all = constants.newton_metres_per_ampere * constants.current_limit_a;
        // No tick wants more than this, whatever the state before it.
        let most = self.step.most(Range::ends(-all, all), part.circle_speed);
        let most = most.low.abs().max(most.high.abs());
        part.wanted = Range::ends(part.wanted.low.max(-most), part.wanted.high.min(most));
        // A speed above the top speed is outside the box: w = s V/V_nominal.
        let nominal = f64::from(constants.nominal_bus_v);
        if part.circle_speed.low > 0.0 {
            let top =
                f64::from(self.operation.top_speed_rad_s) * nominal / f64::from(part.circle_speed.low) * (1.0 + 4.0 * SCALING);
            part.bus_voltage.high = part.bus_voltage.high.min((top as f32).next_up());
        }
        if part.wanted.low > part.wanted.high || part.bus_voltage.low > part.bus_voltage.high {
            return None;
        }
        let own = self.bound(&part);
        part.bound = part.bound.min(own);
        Some(part)
    }

    /// An upper bound of 3 |v|^2 / V^2 in a cell.
    fn bound(&mut self, part: &Part) -> f64 {
        let found = self.step.currents(part.wanted, part.circle_speed, part.trim);
        let (i_d, i_q) = (found.i_d.reals(), found.i_q.reals());
        let [r, l, lambda, p] =
            [self.motor.resistance, self.motor.inductance, self.motor.flux_linkage, self.motor.pole_pairs].map(Interval::point);
        let per_nominal = inverse(Interval::point(f64::from(self.step.constants.nominal_bus_v)));
        let rounding = Interval::new(1.0 - SCALING, 1.0 + SCALING);
        let speed = part.circle_speed.reals();
        let speed = Interval::new((speed.low - SUBNORMAL).max(0.0), speed.high + SUBNORMAL);
        // w_e/V and 1/V.
        let speed = p * speed * per_nominal * rounding;
        let per_bus = inverse(part.bus_voltage.reals());
        let v_d = r * i_d * per_bus - speed * l * i_q;
        let v_q = r * i_q * per_bus + speed * (l * i_d + lambda);
        let sum = squared(v_d) + squared(v_q);
        let bound = (Interval::point(3.0) * sum).high;
        if bound.is_nan() { f64::INFINITY } else { bound }
    }

    /// The halves of the cell along its longest side. A side is measured by its effect on the voltage: the whole span of the scaled speed or of the
    /// wanted current changes it by as much as the limit itself, the span of the bus voltage only by the resistive drop.
    fn cut(&mut self, part: &Part) -> Option<Vec<Part>> {
        let limit = self.step.constants.current_limit_a;
        let sides = [
            (part.circle_speed, 1.0 / self.whole_speed),
            (part.wanted, 0.5 / limit),
            (part.trim, TRIM_WEIGHT / limit),
            (part.bus_voltage, BUS_WEIGHT / self.operation.bus_voltage_v[1]),
        ];
        let length = |(range, weight): &(Range, f32)| (range.high - range.low) * weight;
        let mut order = [0, 1, 2, 3];
        order::descending(&mut order, |it| f64::from(length(&sides[*it])));
        let (side, halves) = order.into_iter().find_map(|side| sides[side].0.halves().map(|halves| (side, halves)))?;
        let halves = halves.map(|half| {
            let mut cut = *part;
            *[&mut cut.circle_speed, &mut cut.wanted, &mut cut.trim, &mut cut.bus_voltage][side] = half;
            self.bounded(cut)
        });
        Some(halves.into_iter().flatten().collect())
    }

    /// A cell as ranges of the box.
    fn named(&self, part: &Part) -> Cell {
        let constants = self.step.constants;
        let nominal = f64::from(constants.nominal_bus_v);
        let (speed, bus, wanted) = (part.circle_speed.reals(), part.bus_voltage.reals(), part.wanted.reals());
        let k_t = f64::from(constants.newton_metres_per_ampere);
        Cell {
            torque_nm: [k_t * wanted.low, k_t * wanted.high],
            speed_rad_s: [
                speed.low * bus.low / nominal,
                (speed.high * bus.high / nominal).min(f64::from(self.operation.top_speed_rad_s)),
            ],
            bus_voltage_v: [bus.low, bus.high],
        }
    }
}

/// x^2 of every x in it.
fn squared(x: Interval) -> Interval {
    let largest = x.magnitude();
    Interval { low: 0.0, high: (Interval::point(largest) * Interval::point(largest)).high }
}

/// 1/x of every x in it, which are positive.
fn inverse(x: Interval) -> Interval {
    Interval { low: (1.0 / x.high).next_down().max(0.0), high: (1.0 / x.low).next_up() }
}
