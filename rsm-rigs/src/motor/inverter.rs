//! A three-phase bridge with a triangular carrier and dead time.
//!
//! In: duties, phase currents, bus voltage. Out: stator-frame voltages, averaged over the period or piece by piece between the edges. Never knows
//! the rotor: between edges the voltage stands still in the stator's frame, so it turns in the rotor's.
//!
//! Dead time t_d: each switch closes t_d after the other has opened. Meanwhile a diode carries the current: the lower one when it flows into the
//! motor, the upper one when it flows out. So a leg's upper time shrinks by t_d with positive and grows by t_d with negative current. A leg that
//! does not switch in a period (duty 0 or 1) loses nothing.

use super::park::from_phases;

/// How the bridge is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fidelity {
    /// The mean voltage of each period, dead time included: no ripple.
    #[default]
    Averaged,
    /// Every edge at its instant.
    Switched,
}

/// The bridge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inverter {
    /// Carrier period, in s.
    pub period: f64,
    /// Dead time, in s.
    pub dead_time: f64,
    /// Bus voltage, in V.
    pub bus_voltage: f64,
}

/// A leg's change of state: at this time of the period the leg goes up or down.
#[derive(Debug, Clone, Copy)]
struct Edge {
    time: f64,
    leg: usize,
    up: bool,
    /// The dead time, if there is one, has passed.
    certain: bool,
}

/// The edges of one period, to be taken in order of time.
#[derive(Debug, Clone, Copy)]
pub struct Edges {
    edges: [Option<Edge>; 6],
    levels: [bool; 3],
    at: f64,
    inverter: Inverter,
}

impl Inverter {
    /// The stator-frame voltage, alpha and beta, averaged over a period in which the currents keep their signs.
    #[must_use]
    pub fn average(&self, duties: [f64; 3], currents: [f64; 3]) -> [f64; 2] {
        let lost = self.dead_time / self.period;
        let mut legs = [0.0; 3];
        for ((leg, duty), current) in legs.iter_mut().zip(duties).zip(currents) {
            let switches = duty > 0.0 && duty < 1.0;
            let sign = if current > 0.0 {
                1.0
            } else if current < 0.0 {
                -1.0
            } else {
                0.0
            };
            let effective = if switches { (duty - lost * sign).clamp(0.0, 1.0) } else { duty };
            *leg = self.bus_voltage * effective;
        }
        from_phases(legs)
    }

    /// The edges of a period that starts at the carrier's peak: a leg is up in the middle of the period, for its duty's share.
    #[must_use]
    pub fn edges(&self, duties: [f64; 3]) -> Edges {
        let mut edges = [None; 6];
        let mut levels = [false; 3];
        for (leg, duty) in duties.into_iter().enumerate() {
            if duty >= 1.0 {
                levels[leg] = true;
            } else if duty > 0.0 {
                let half = 0.5 * self.period * duty;
                let middle = 0.5 * self.period;
                edges[2 * leg] = Some(Edge { time: middle - half, leg, up: true, certain: false });
                edges[2 * leg + 1] = Some(Edge { time: middle + half, leg, up: false, certain: false });
            }
        }
        Edges { edges, levels, at: 0.0, inverter: *self }
    }
}

impl Edges {
    /// The next piece: how long it lasts, in s, and its stator-frame voltage. `currents` are those at its start, which is the end of the piece
    /// before. `None` at the end of the period. A piece may be of length 0.
    pub fn next(&mut self, currents: [f64; 3]) -> Option<(f64, [f64; 2])> {
        let Inverter { period, dead_time, bus_voltage } = self.inverter;
        // What is due now: an edge that waits for a dead time is put off, any other is done.
        while let Some((place, edge)) = self.first().filter(|(_, edge)| edge.time <= self.at) {
            let current = currents[edge.leg];
            let diode_holds = (edge.up && current > 0.0) || (!edge.up && current < 0.0);
            if diode_holds && !edge.certain {
                self.edges[place] = Some(Edge { time: edge.time + dead_time, certain: true, ..edge });
                continue;
            }
            self.edges[place] = None;
            // A pulse shorter than the dead time does not appear: its end comes before its late beginning.
            let other = place ^ 1;
            if !edge.up && self.edges[other].is_some_and(|other| other.up) {
                self.edges[other] = None;
            }
            self.levels[edge.leg] = edge.up;
        }
        if self.at >= period {
            return None;
        }
        let until = self.first().map_or(period, |(_, edge)| edge.time.min(period));
        let voltage = from_phases(self.levels.map(|up| if up { bus_voltage } else { 0.0 }));
        let span = until - self.at;
        self.at = until;
        Some((span, voltage))
    }

    fn first(&self) -> Option<(usize, Edge)> {
        let waiting = self.edges.iter().enumerate().filter_map(|(place, edge)| edge.map(|edge| (place, edge)));
        waiting.min_by(|(_, one), (_, other)| one.time.total_cmp(&other.time))
    }
}
