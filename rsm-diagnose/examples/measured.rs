//! Measured data as records that `rsm diagnose` reads, how well a free run follows the measured axis, and what repeats with the rotation of the
//! measured outrunner.
//!
//! In: the folder of the measured data and one to write to. Out: records as CSV, amplitudes over the order of rotation as CSV and as drawings; errors
//! and the largest waves as text.
//!
//!     cargo run --release -p rsm-diagnose --example measured -- ../shared/data FOLDER

use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;

use rsm_core::source::Source;
use rsm_diagnose::plant::free_run;
use rsm_diagnose::plant::rotation::{Wave, wave};
use rsm_fit::table::{Table, Wanted};
use rsm_sim::plant_file::PlantFile;
use rsm_sim::record::Record;

/// Orders of rotation that are looked at: twice the sixth electrical order of twelve pole pairs.
const ORDERS: u32 = 150;

/// The outrunner's log has a row a millisecond, with jitter.
const PERIOD_S: f64 = 1e-3;

/// Rows of the outrunner's records that are written: the search takes minutes over all of them, and ten revolutions tell as much.
const ROWS: usize = 1300;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [data, out] = arguments.as_slice() else {
        return Err("usage: measured DATA FOLDER: the folder of the measured data, and one to write to".into());
    };
    let (data, out) = (Path::new(data), Path::new(out));
    std::fs::create_dir_all(out)?;
    axis(data, out)?;
    axis_in_open_loop(data)?;
    let (mut speeds, mut currents) = (Vec::new(), Vec::new());
    for name in ["rolling_1", "rolling_2"] {
        let columns = read(&data.join(format!("bldc-cogging/{name}.csv")), &["pos_rad", "vel_rad_s", "i_q_A", "u_q_V"])?;
        let [angle, speed, current, voltage] = columns.as_slice() else { unreachable!("four columns were asked for") };
        let waves = |values: &[f64]| (1..=ORDERS).map(|order| wave(angle, values, order)).collect::<Vec<Wave>>();
        speeds.push(waves(speed));
        currents.push(waves(current));
        // Ten revolutions at the logger's 1 ms: their instants jitter, by far less than the waves that are looked for.
        let mut text = "time[s],v_q[V],load_torque[N*m],angle[rad],i_q[A],speed[rad/s]\n".to_string();
        let rows = angle.iter().zip(voltage).zip(current).zip(speed).take(ROWS);
        for (k, (((angle, voltage), current), speed)) in rows.enumerate() {
            writeln!(text, "{},{voltage},0,{angle},{current},{speed}", k as f64 * PERIOD_S)?;
        }
        std::fs::write(out.join(format!("{name}.csv")), text)?;
    }
    for (name, unit, waves) in [("speed", "rad/s", &speeds), ("current", "A", &currents)] {
        let mut text = format!("order,amplitude_1[{unit}],amplitude_2[{unit}],phase_1[rad],phase_2[rad],share_1,share_2\n");
        for (a, b) in waves[0].iter().zip(&waves[1]) {
            writeln!(text, "{},{},{},{},{},{},{}", a.order, a.amplitude, b.amplitude, a.phase, b.phase, a.share, b.share)?;
        }
        std::fs::write(out.join(format!("orders_{name}.csv")), text)?;
        std::fs::write(out.join(format!("orders_{name}.svg")), drawing(name, unit, &waves[0], &waves[1])?)?;
        let mut largest: Vec<(&Wave, &Wave)> = waves[0].iter().zip(&waves[1]).collect();
        largest.sort_by(|a, b| b.0.amplitude.total_cmp(&a.0.amplitude));
        for (a, b) in largest.iter().take(5) {
            println!(
                "{name}, {:3} a revolution: {:.4} and {:.4} {unit}, {:4.1} and {:4.1} % of the variance, {:4.0} and {:4.0} degrees",
                a.order,
                a.amplitude,
                b.amplitude,
                100.0 * a.share,
                100.0 * b.share,
                a.phase.to_degrees(),
                b.phase.to_degrees()
            );
        }
    }
    Ok(())
}

/// The axis under its pulses: volts behind the controller are metres of the reference before it.
fn axis(data: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants/emps.toml");
    let file = PlantFile::read(&Source::read(&file)?)?;
    let gain = file.parameters.number("position_gain") * file.parameters.number("velocity_gain");
    let names = ["t_s", "q_ref_m", "q_m", "u_V", "pulse"];
    let columns = read(&data.join("emps/emps_test_pulses.csv"), &names)?;
    let [time, reference, position, command, pulse] = columns.as_slice() else { unreachable!("five columns were asked for") };
    let mut text = names[..4].join(",") + "\n";
    for ((((time, reference), position), command), pulse) in time.iter().zip(reference).zip(position).zip(command).zip(pulse) {
        writeln!(text, "{time},{},{position},{command}", reference + pulse / gain)?;
    }
    std::fs::write(out.join("emps_test_pulses.csv"), text)?;
    Ok(())
}

/// From the recorded command to the position, fitted to the training record: root mean square errors of the position. Small forces add up: a newton
/// that lasts moves the axis by millimetres in seconds.
fn axis_in_open_loop(data: &Path) -> Result<(), Box<dyn Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rsm-sim/plants/emps-open.toml");
    let file = PlantFile::read(&Source::read(&file)?)?;
    let record = |name: &str| -> Result<Record, Box<dyn Error>> {
        Ok(Record::read(&Source::read(&data.join("emps").join(name))?, &file)?)
    };
    let (training, test) = (record("emps_train.csv")?, record("emps_test_pulses.csv")?);
    let free_runs =
        free_run::axis_free_runs(&file, &training, &test).ok_or("the axis cannot be simulated along its records")?;
    println!("EMPS in open loop, recorded command to position, root mean square error:");
    for (what, error) in free_runs.errors {
        println!("  {:5.2} mm  {what}", 1e3 * error);
    }
    Ok(())
}

fn read(path: &Path, names: &[&str]) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let numbers = names.iter().map(|name| (*name).to_string()).collect();
    let table = Table::read(&Source::read(path)?, &Wanted { numbers, ..Wanted::default() })?;
    let column = |name: &&str| table.column(name).map(|column| column.values.clone()).unwrap_or_default();
    Ok(names.iter().map(column).collect())
}

/// Amplitudes over the order, both records side by side.
fn drawing(name: &str, unit: &str, one: &[Wave], other: &[Wave]) -> Result<String, std::fmt::Error> {
    let most = one.iter().chain(other).map(|it| it.amplitude).fold(f64::MIN_POSITIVE, f64::max);
    let mut text =
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 980 330\" font-family=\"sans-serif\" font-size=\"12\">\n"
            .to_string();
    writeln!(
        text,
        "<text x=\"40\" y=\"18\">{name}: amplitude [{unit}] over waves a revolution, largest {most:.4}; dark rolling_1, light rolling_2</text>"
    )?;
    writeln!(text, "<path d=\"M40 300H960\" stroke=\"black\"/>")?;
    for (waves, shift, colour) in [(one, 0.0, "#204060"), (other, 2.5, "#80b0e0")] {
        for it in waves {
            let (x, height) = (40.0 + 6.0 * f64::from(it.order) + shift, 270.0 * it.amplitude / most);
            writeln!(
                text,
                "<rect x=\"{x}\" y=\"{:.2}\" width=\"2.5\" height=\"{height:.2}\" fill=\"{colour}\"/>",
                300.0 - height
            )?;
        }
    }
    for order in (12..=ORDERS).step_by(12) {
        writeln!(text, "<text x=\"{}\" y=\"316\" text-anchor=\"middle\">{order}</text>", 42.5 + 6.0 * f64::from(order))?;
    }
    text.push_str("</svg>\n");
    Ok(text)
}
