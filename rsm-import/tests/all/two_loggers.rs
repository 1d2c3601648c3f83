//! Whole imports: tables as loggers of several tools write them, their records read again.

use rsm_import::{File, Record, Wishes, import};

fn file(name: &str, text: &str) -> File {
    File { name: name.to_string(), bytes: text.as_bytes().to_vec() }
}

fn column<'a>(record: &'a Record, name: &str) -> &'a [f64] {
    &record.columns.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("no `{name}`")).values
}

/// What both loggers see: it does not repeat.
fn speed(time: f64) -> f64 {
    100.0 + 40.0 * (0.7 * time).sin() + 25.0 * (1.93 * time + 1.0).sin() + 60.0 / (1.0 + (-(time - 13.0) / 0.3).exp())
}

fn current(time: f64) -> f64 {
    5.0 + 3.0 * (1.1 * time).sin()
}

#[test]
fn two_loggers_give_one_record() {
    let mut bench = "Zeit [s];Drehzahl [U/min];Moment [Nm]\n".to_string();
    for k in 0..3000 {
        let time = 0.01 * f64::from(k);
        bench += &format!("{time:.3};{:.3};{:.3}\n", speed(time) * 30.0 / std::f64::consts::PI, 0.1 * time).replace('.', ",");
    }
    // The inverter's clock began 742.5 s before, runs 150 ppm fast and jitters.
    let mut drive = "t,omega[rad/s],i_q[A]\n".to_string();
    let mut shift = 0.37;
    for k in 0..3600 {
        shift = (shift * 997.0_f64 + 0.1234).fract();
        let time = -2.0 + 0.009 * (f64::from(k) + 0.4 * shift);
        drive += &format!("{:.6},{:.4},{:.5}\n", 742.5 + time * 1.00015, speed(time), current(time));
    }
    let files = [file("bench.csv", &bench), file("drive.csv", &drive)];
    let said = import(&files, &Wishes::default()).unwrap_err().to_string();
    assert!(said.contains("--align FIRST=SECOND"), "{said}");
    let wishes = Wishes {
        columns: ["speed=Drehzahl[rad/s]", "torque=Moment", "i_q=i_q"].map(|text| text.parse().unwrap()).to_vec(),
        constants: vec!["load_torque=0[N*m]".parse().unwrap()],
        align: Some("Drehzahl=omega".parse().unwrap()),
        ..Wishes::default()
    };
    let record = import(&files, &wishes).unwrap();
    let found = &record.alignments[0];
    // first = second + offset + rate (second - middle), from second = 742.5 + 1.00015 first.
    let first = (found.middle - 742.5) / 1.00015;
    assert!((found.middle + found.offset - first).abs() < 0.001, "{found:?}");
    assert!((found.rate + 150e-6).abs() < 20e-6, "{found:?}");
    // The second logger ends after the first: nothing is left out.
    assert_eq!((record.rows(), record.is_resampled, record.columns.len()), (3000, true, 4));
    for (time, value) in record.time.iter().zip(column(&record, "i_q")) {
        assert!((value - current(*time)).abs() < 0.01, "{time}: {value}");
    }
    for (time, value) in record.time.iter().zip(column(&record, "speed")) {
        assert!((value - speed(*time)).abs() < 0.001, "{time}: {value}");
    }
    assert_eq!(column(&record, "load_torque"), [0.0; 3000]);
    // The record reads itself back, every bit of it.
    let again = import(&[file("clean.csv", &record.csv())], &Wishes::default()).unwrap();
    assert!(!again.is_resampled, "{:?}", again.notes);
    assert_eq!(again.time, record.time);
    for column_ in &record.columns {
        assert_eq!(column(&again, &column_.name), column_.values);
    }
}

#[test]
fn one_logger_with_every_untidiness() {
    // Latin-1, a unit in each header, two columns of one name, one empty cell, one row twice, jitter, a gap.
    let mut text = "Prüfstand 3;;;;;\nZeit (ms);Druck [µbar];Druck [µbar];Gang;Kühlwasser in °C;Bemerkung\n".to_string();
    let mut late = 0.5;
    for k in (0..400).filter(|k| !(200..230).contains(k)) {
        late = (late * 613.0_f64 + 0.357).fract();
        let time = 10.0 * f64::from(k) + 3.0 * late;
        let cool = if k == 50 { String::new() } else { format!("{:.2}", 80.0 + 0.01 * time) };
        let row = format!("{time:.3};{:.3};{:.3};{};{cool};ok\n", 2.0 * time, 3.0 * time, 1 + k / 100).replace('.', ",");
        text += &row;
        if k == 70 {
            text += &row;
        }
    }
    let latin = File { name: "p.csv".into(), bytes: text.chars().map(|sign| sign as u8).collect() };
    let record = import(std::slice::from_ref(&latin), &Wishes::default()).unwrap();
    let all = record.notes.join("\n");
    for word in [
        "Latin-1",
        "jitter",
        "`Druck_2`",
        "instant of the row before",
        "1 gaps",
        "resampled",
        "`Bemerkung` contains text",
        "`Gang` steps",
    ] {
        assert!(all.contains(word), "{word} is not in\n{all}");
    }
    assert_eq!(record.period, 0.01);
    assert!((365..=371).contains(&record.rows()), "{}", record.rows());
    for (row, time) in record.time.iter().enumerate() {
        assert!(!(2.0..2.29).contains(time), "a row within the gap: {time}");
        // Straight lines stay straight lines, to the decimals of the file.
        assert!((column(&record, "Druck")[row] - 2000.0 * time).abs() < 0.01);
        assert!((column(&record, "Druck_2")[row] - 3000.0 * time).abs() < 0.01);
        assert!((column(&record, "Kühlwasser")[row] - 80.0 - 10.0 * time).abs() < 0.02);
        assert!(column(&record, "Gang")[row].fract() == 0.0);
    }
    assert_eq!(
        record.columns.iter().map(|it| it.unit.as_deref()).collect::<Vec<_>>(),
        [Some("µbar"), Some("µbar"), None, Some("°C")]
    );
    // A period that is wished, and one that makes no sense.
    let wishes = Wishes { period: Some(0.05), ..Wishes::default() };
    assert_eq!(import(std::slice::from_ref(&latin), &wishes).unwrap().period, 0.05);
    for period in [0.0, -1.0, f64::NAN, 1e-9] {
        let wishes = Wishes { period: Some(period), ..Wishes::default() };
        assert!(import(std::slice::from_ref(&latin), &wishes).unwrap_err().to_string().contains("a period of"), "{period}");
    }
}

#[test]
fn what_is_wrong_is_said() {
    let text = "t[s],x[m],words\n0,1,a\n1,2,b\n2,3,c\n3,5,d\n";
    let with = |change: &dyn Fn(&mut Wishes)| {
        let mut wishes = Wishes::default();
        change(&mut wishes);
        import(&[file("a.csv", text)], &wishes).map(|record| record.csv()).map_err(|faults| faults.to_string())
    };
    let said = |change: &dyn Fn(&mut Wishes)| with(change).unwrap_err();
    let column = |text: &str| vec![text.parse().unwrap()];
    assert!(
        said(&|it| it.columns = column("v=speed"))
            .contains("there is no column `speed`; the columns are a.csv: `t`, `x`, `words`")
    );
    assert!(said(&|it| it.columns = column("v=words")).contains("found text such as `a`, expected numbers"));
    assert!(said(&|it| it.columns = column("v=x[V]")).contains("measure different things"));
    assert!(said(&|it| it.columns = column("time=x")).contains("found the name `time` for two columns"));
    assert!(said(&|it| it.time = Some("u".into())).contains("there is no column `u` for the time"));
    assert!(said(&|it| it.constants = column("x=1[m]")).contains("has a column of this name"));
    assert!(said(&|it| it.constants = column("y=1")).contains("write its unit"));
    assert!(said(&|it| it.constants = column("y=one[m]")).contains("found `one`, expected a number"));
    assert!("speed".parse::<rsm_import::Named>().is_err() && "a,b=c".parse::<rsm_import::Named>().is_err());
    let clean = with(&|it| it.columns = column("y=X[mm]")).unwrap();
    assert!(clean.ends_with("time[s],y[mm]\n0.0,1000.0\n1.0,2000.0\n2.0,3000.0\n3.0,5000.0\n"), "{clean}");
    // No time: refused, unless the period is given.
    let bare = "x[m],y[m]\n1,2\n2,3\n3,4\n4,6\n";
    assert!(import(&[file("b.csv", bare)], &Wishes::default()).unwrap_err().to_string().contains("no column is called time"));
    let wishes = Wishes { period: Some(0.5), ..Wishes::default() };
    assert_eq!(import(&[file("b.csv", bare)], &wishes).unwrap().time, [0.0, 0.5, 1.0, 1.5]);
    for (bytes, word) in [(&b""[..], "empty"), (b"PK\x03\x04rest", "zip"), (b"\x01\x00\x02\x00\x00\x03", "neither text")] {
        let file = File { name: "c".into(), bytes: bytes.to_vec() };
        let said = import(&[file], &Wishes::default()).unwrap_err().to_string();
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn dates_and_midnight() {
    let text = "Timestamp,x[m]\n23:59:59.0,1\n23:59:59.5,2\n00:00:00.0,3\n00:00:00.5,4\n";
    let record = import(&[file("d.csv", text)], &Wishes::default()).unwrap();
    assert_eq!(record.time, [0.0, 0.5, 1.0, 1.5]);
    let text = "date/time;x [m]\n31.12.2024 23:59:59,9;1\n01.01.2025 00:00:00,0;2\n01.01.2025 00:00:00,1;3\n";
    let record = import(&[file("d.csv", text)], &Wishes::default()).unwrap();
    assert!((record.period - 0.1).abs() < 1e-6, "{record:?}");
}
