//! An incremental encoder and its evaluation in a drive: an angle between the edges, a speed from the times of edges.
//!
//! In: the true angle at the ends of each PWM period. Out: measured angle and speed. The drive has a capture timer, which gives the time of each
//! edge. It has no other information from the lines. The zero of the angle is known from the start (an index pulse, a Hall signal or an alignment).
//!
//! Angle: with interpolation it is the angle of the last edge plus the measured speed times the time since that edge, at most one count; without
//! interpolation it is the middle of the count. Speed: in a PWM period with an edge it is the counts between two captured edges over the time between
//! them. So at constant speed it has no quantisation error, however coarse the lines. Without an edge the speed is limited to one count in the time
//! since the last edge. A first-order filter follows.

use std::f64::consts::TAU;

/// Which encoder, and what the drive does with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Lines a turn; `None` for an ideal sensor of angle and speed.
    pub lines: Option<u32>,
    /// Both edges of both tracks are counted: four counts a line instead of one.
    pub quadrature: bool,
    /// The angle moves on between the edges.
    pub interpolated: bool,
    /// Time constant of the filter behind the speed, in s; 0 for none.
    pub filter: f64,
}

impl Settings {
    /// A coarse one: 64 lines in quadrature, 256 counts a turn, interpolated. At 7500 rpm an edge comes every 31 us, three a PWM period of 10 kHz; at
    /// 100 rpm every 2.3 ms. The filter's 1 ms is one period of the loop that reads the speed.
    pub const COARSE: Settings = Settings { lines: Some(64), quadrature: true, interpolated: true, filter: 0.001 };

    /// A fine one, as servo drives have.
    pub const FINE: Settings = Settings { lines: Some(4096), ..Settings::COARSE };

    /// None of the errors of an encoder.
    pub const IDEAL: Settings = Settings { lines: None, quadrature: false, interpolated: false, filter: 0.0 };
}

/// The reading of the drive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reading {
    /// Mechanical angle, in rad, turns counted.
    pub angle: f64,
    /// Mechanical speed, in rad/s.
    pub speed: f64,
}

/// An encoder with its state.
#[derive(Debug, Clone)]
pub struct Encoder {
    settings: Settings,
    /// One count, in rad; 0 for the ideal sensor.
    count: f64,
    period: f64,
    /// How far the filter goes in a period: the exact answer of a first-order lag to an input that is held.
    filter_share: f64,
    /// The count that the angle is in: `floor(angle/count)`.
    cell: f64,
    /// Angle and time of the last edge; the time is `None` before the first.
    edge: (f64, Option<f64>),
    before: f64,
    raw_speed: f64,
    reading: Reading,
}

impl Encoder {
    /// An encoder that is read every `period` (s), its rotor at an angle (rad); `speed` (rad/s) is where the filter starts.
    #[must_use]
    pub fn new(settings: Settings, period: f64, angle: f64, speed: f64) -> Self {
        let factor = if settings.quadrature { 4.0 } else { 1.0 };
        let count = settings.lines.map_or(0.0, |lines| TAU / (f64::from(lines) * factor));
        let cell = if count > 0.0 { (angle / count).floor() } else { 0.0 };
        let reading = Reading { angle: if count > 0.0 { (cell + 0.5) * count } else { angle }, speed };
        let filter_share = if settings.filter > 0.0 { 1.0 - (-period / settings.filter).exp() } else { 1.0 };
        Encoder {
            settings,
            count,
            period,
            filter_share,
            cell,
            edge: (reading.angle, None),
            before: angle,
            raw_speed: speed,
            reading,
        }
    }

    /// The reading as it is now.
    #[must_use]
    pub fn reading(&self) -> Reading {
        self.reading
    }

    /// The reading at the end of a period that began at `time` (s), in which the rotor came to `angle` (rad) at `speed` (rad/s).
    pub fn read(&mut self, time: f64, angle: f64, speed: f64) -> Reading {
        let now = time + self.period;
        let mut raw = speed;
        if self.count > 0.0 {
            raw = self.counted(time, angle);
        } else {
            self.reading.angle = angle;
        }
        self.reading.speed += self.filter_share * (raw - self.reading.speed);
        if self.count > 0.0 {
            self.reading.angle = self.between_edges(now);
        }
        self.before = angle;
        self.reading
    }

    /// The speed from edges.
    fn counted(&mut self, time: f64, angle: f64) -> f64 {
        let cell = (angle / self.count).floor();
        let now = time + self.period;
        if cell != self.cell {
            // Within a period of the PWM the speed hardly changes: the edge's instant by a straight line.
            let edge = if cell > self.cell { cell } else { cell + 1.0 } * self.count;
            let at = time + self.period * ((edge - self.before) / (angle - self.before)).clamp(0.0, 1.0);
            if let (last, Some(then)) = self.edge {
                // After a reversal the same edge comes again: the distance and the speed are 0.
                self.raw_speed = if at > then { (edge - last) / (at - then) } else { self.raw_speed };
            }
            self.edge = (edge, Some(at));
            self.cell = cell;
        } else if let Some(then) = self.edge.1 {
            let most = self.count / (now - then);
            self.raw_speed = self.raw_speed.clamp(-most, most);
        }
        self.raw_speed
    }

    /// The angle now.
    fn between_edges(&self, now: f64) -> f64 {
        let middle = (self.cell + 0.5) * self.count;
        match self.edge {
            (edge, Some(then)) if self.settings.interpolated => {
                let low = self.cell * self.count;
                (edge + self.reading.speed * (now - then)).clamp(low, low + self.count)
            }
            _ => middle,
        }
    }
}
