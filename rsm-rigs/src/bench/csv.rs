//! The table that the bench writes.
//!
//! In: outcomes. Out: a CSV with a row for every run that came to the voltage limit, in the order of the runs; the others are told in comments,
//! because their points do not lie on the boundary that a fit looks for. Never drops a run silently.

use std::fmt::Write as _;

use rsm_core::number::decimal;

use super::{Outcome, Point};

const HEADER: &str = "run[1],depth[%],advance[deg],torque[N*m],speed[rad/s],i_d[A],i_q[A],current[A],weakening_current[A],\
                      current_advance[deg],weakening_angle[deg],voltage[V],shaft_torque[N*m]";

/// The CSV of a bench's runs.
#[must_use]
pub fn csv(outcomes: &[Outcome]) -> String {
    let mut text = format!("{HEADER}\n");
    for outcome in outcomes {
        match outcome {
            Outcome::AtLimit(point) => row(&mut text, point),
            Outcome::BelowLimit(Point { setting, speed, voltage, .. }) => {
                let _ = writeln!(
                    text,
                    "# run {}: depth {} %, advance {} deg: {voltage:.1} V at the dynamometer's top speed ({speed:.0} rad/s), below the limit",
                    setting.run, setting.depth, setting.advance
                );
            }
            Outcome::Tripped(setting) => {
                let _ = writeln!(
                    text,
                    "# run {}: depth {} %, advance {} deg: more than twice the current limit, switched off",
                    setting.run, setting.depth, setting.advance
                );
            }
        }
    }
    text
}

fn row(text: &mut String, point: &Point) {
    // Six digits behind the point are below the noise by four orders, and keep the table readable.
    let numbers = [
        point.torque,
        point.speed,
        point.i_d,
        point.i_q,
        point.i_d.hypot(point.i_q),
        -point.i_d,
        (-point.i_d).atan2(point.i_q).to_degrees(),
        // The same from the nearer half of the q axis: 0 to 90 degrees, driving and braking alike.
        (-point.i_d).atan2(point.i_q.abs()).to_degrees(),
        point.voltage,
        point.shaft_torque,
    ];
    let setting = point.setting;
    let cells: Vec<String> = numbers.iter().map(|number| format!("{number:.6}")).collect();
    let _ = writeln!(text, "{},{},{},{}", setting.run, decimal(setting.depth), decimal(setting.advance), cells.join(","));
}
