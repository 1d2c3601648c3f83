//! Tests of the catalogue and of the rewriting, on plants with simple equations.

use rsm_core::source::Source;

use super::{Catalogue, Effect, Placed, SiteKind, Start, extend, sites_of};
use crate::flat::{Flat, Options};
use crate::shipped;
use crate::system::System;

fn flat(name: &str) -> Flat {
    let (name, model) = name.split_once('#').map_or((name, None), |(a, b)| (a, Some(b.to_string())));
    Flat::read(&shipped::text(name).unwrap(), &Options { model, parameters: Vec::new() }).unwrap()
}

/// Values for the parameters of an effect that are inside all bounds.
fn numbers(effect: &Effect, kind: SiteKind) -> Vec<(String, f64)> {
    let all = effect.numbers_on(kind).filter(|it| it.default.is_none());
    all.map(|it| (it.name.clone(), if it.is_whole { 3.0 } else { 0.5 })).collect()
}

#[test]
fn every_shipped_effect_stands_somewhere_on_a_shipped_plant_or_is_for_plants_that_are_not_shipped() {
    let catalogue = Catalogue::shipped();
    let mut nowhere = Vec::new();
    for effect in catalogue.effects() {
        let mut stands = 0;
        for plant in ["pmac", "driveline", "servo-axis#ServoAxis", "servo-axis#ServoAxisClosedLoop"] {
            let flat = flat(plant);
            let sites = sites_of(&flat.name);
            let signals = flat.symbols().map(|it| flat.variable(it).name.clone());
            let all: Vec<String> = sites.iter().map(|it| it.name.clone()).chain(signals).collect();
            for at in all {
                let kind = sites.iter().find(|it| it.name == at).map(|it| it.kind);
                let kind = kind.or_else(|| effect.sites.iter().copied().find(|_| true)).unwrap();
                let placed = Placed {
                    effect,
                    at: Some(at.clone()),
                    numbers: numbers(effect, kind),
                    source: Source::new("plant.toml", ""),
                    place: 0..0,
                };
                match extend(&flat, &sites, &[placed]) {
                    Ok(extended) => {
                        let system = System::new(&extended.flat);
                        assert!(system.is_ok(), "{} at {at} of {plant}: {}", effect.kind, system.unwrap_err());
                        stands += 1;
                    }
                    Err(faults) => {
                        let text = faults.to_string();
                        let expected = [
                            "has no",
                            "expected",
                            "does not name",
                            "determines the structure of the equations",
                            "expected a single variable",
                            "can be delayed",
                            "is missing",
                            "no single equation",
                            "a vector of 2",
                        ];
                        assert!(expected.iter().any(|it| text.contains(it)), "{} at {at} of {plant}: {text}", effect.kind);
                    }
                }
            }
        }
        if stands == 0 {
            nowhere.push(effect.kind.clone());
        }
    }
    // None of the three plants has a tank or a heat capacity.
    assert_eq!(nowhere, ["leak", "overflow", "radiation"]);
}

/// Each kind of site of each shipped effect, with the first guesses there.
fn all_starts(catalogue: &Catalogue) -> Vec<(&Effect, SiteKind, Vec<Start>)> {
    let mut all = Vec::new();
    for effect in catalogue.effects() {
        for kind in &effect.sites {
            let roles = kind.roles().iter().map(|it| (it.0, 0.5));
            let scales: Vec<(&str, f64)> = super::SCALES.iter().map(|it| (*it, 1.5)).chain(roles).collect();
            let starts = effect.starts(*kind, &scales).unwrap_or_else(|faults| panic!("{}: {faults}", effect.kind));
            all.push((effect, *kind, starts));
        }
    }
    all
}

#[test]
fn every_guess_of_every_effect_has_a_value() {
    for (effect, kind, starts) in all_starts(&Catalogue::shipped()) {
        for start in starts {
            for (name, value) in &start.numbers {
                let number = effect.numbers_on(kind).find(|it| it.name == *name).unwrap();
                assert_eq!(number.refuses(*value), None, "{}: {name} = {value}", effect.kind);
            }
        }
    }
}

/// A screen is of first order about a guess. If a number scales the effect, this is exact for any size. Otherwise one guess sees only effects of its
/// own size, so there are several.
#[test]
fn an_effect_without_a_number_that_scales_it_has_guesses_of_several_sizes() {
    let mut several = 0;
    for (effect, kind, starts) in all_starts(&Catalogue::shipped()) {
        // A rounding step is read off the record, and a wrong parameter is near its nominal value.
        let has_one = ["sensor-quantisation", "parameter-error"].contains(&effect.kind.as_str());
        if !has_one && starts.iter().all(|it| it.neutral.is_none() && !it.numbers.is_empty()) {
            assert!(starts.len() > 1, "{} on {kind:?}: {starts:?}", effect.kind);
            several += 1;
        }
    }
    assert!(several > 5, "{several}");
}

/// An effect with its place and its numbers.
type Wanted<'w> = (&'w str, Option<&'w str>, &'w [(&'w str, f64)]);

/// The rate of a state after effects, as text.
fn rate(text: &str, sites: &str, effects: &[Wanted<'_>], state: &str) -> String {
    let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap();
    let file = Source::new("plant.toml", sites);
    let mut faults = rsm_core::source::Collector::new();
    let document = rsm_core::toml_reader::parse(&file, &mut faults).unwrap();
    let mut top = rsm_core::toml_reader::TableReader::document(&file, &document);
    let sites = top.optional("sites").map_or_else(Vec::new, |it| super::Site::read_all(&file, it, &mut faults));
    faults.finish(Some(())).unwrap();
    let catalogue = Catalogue::shipped();
    let placed: Vec<Placed<'_>> = effects
        .iter()
        .map(|(kind, at, numbers)| Placed {
            effect: catalogue.find(kind).unwrap(),
            at: at.map(str::to_string),
            numbers: numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect(),
            source: file.clone(),
            place: 0..0,
        })
        .collect();
    let extended = extend(&flat, &sites, &placed).unwrap_or_else(|faults| panic!("{faults}"));
    let system = System::new(&extended.flat).unwrap_or_else(|faults| panic!("{faults}"));
    let place = system.states().iter().position(|it| system.name(*it) == state).unwrap();
    system.text(system.rates()[place])
}

#[test]
fn a_balance_takes_an_effort_in_whatever_form_it_is_written() {
    let text = |law: &str| {
        format!(
            "model M\n  parameter Real m = 2;\n  input Real u;\n  output Real v;\n  Real x;\nequation\n  {law};\n  der(x) = v;\nend M;\n"
        )
    };
    let site = "[sites.body]\nkind = \"translation\"\nposition = \"x\"\nspeed = \"v\"\ninertia = \"m\"\n";
    let load: [Wanted<'_>; 1] = [("constant-load", None, &[("force", 3.0)])];
    let force = "constant-load(body).force";
    for (law, wanted) in [
        ("m*der(v) = u", format!("(u - {force})/m")),
        ("u = m*der(v)", format!("-({force} - u)/m")),
        ("der(v) = u/m", format!("u/m - 1/m*{force}")),
        ("0 = u - m*der(v)", format!("(u - {force})/m")),
    ] {
        let found = rate(&text(law), site, &load, "v");
        let same = |text: &str| text.replace(['(', ')', ' '], "");
        assert_eq!(same(&found), same(&wanted), "{law}");
    }
}

#[test]
fn an_inertia_that_is_a_part_of_what_moves_is_refused() {
    // A car on wheels: an effort on its speed moves the wheels too. If the mass were the whole inertia, the effort would act 1 + J/(m r^2) times as
    // strongly.
    let text = "model M\n  parameter Real m = 1400;\n  parameter Real J = 4;\n  parameter Real r = 0.3;\n  input Real u;\n  output Real v;\n  Real w;\nequation\n  v = r*w;\n  (J + m*r^2)*der(w) = u;\nend M;\n";
    let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap();
    let stands = |inertia: &str| {
        let file = format!("[sites.car]\nkind = \"translation\"\nspeed = \"v\"\ninertia = \"{inertia}\"\n");
        let file = Source::new("plant.toml", file);
        let mut faults = rsm_core::source::Collector::new();
        let document = rsm_core::toml_reader::parse(&file, &mut faults).unwrap();
        let mut top = rsm_core::toml_reader::TableReader::document(&file, &document);
        let sites = super::Site::read_all(&file, top.optional("sites").unwrap(), &mut faults);
        let catalogue = Catalogue::shipped();
        let placed = Placed {
            effect: catalogue.find("coulomb-friction").unwrap(),
            at: None,
            numbers: vec![("force".to_string(), 20.0)],
            source: file.clone(),
            place: 0..0,
        };
        extend(&flat, &sites, &[placed]).map(|_| ()).map_err(|faults| faults.to_string())
    };
    assert_eq!(stands("m + J/r^2"), Ok(()));
    // The equation divided by two is also valid.
    assert_eq!(stands("0.5*(m + J/r^2)"), Ok(()));
    let told = stands("m").unwrap_err();
    assert!(told.contains("the balance of line 10 contains `der(w)` times") && told.contains("is only a part of"), "{told}");
}

#[test]
fn effects_on_an_input_act_in_the_order_of_the_file() {
    let text = "model M\n  input Real u;\n  output Real y;\nequation\n  der(y) = u;\nend M;\n";
    let gain: Wanted<'_> = ("input-gain", Some("u"), &[("gain", 2.0)]);
    let bias: Wanted<'_> = ("input-bias", Some("u"), &[("bias", 1.0)]);
    assert_eq!(rate(text, "", &[gain, bias], "y"), "input-gain(u).gain*u + input-bias(u).bias");
    assert_eq!(rate(text, "", &[bias, gain], "y"), "input-gain(u).gain*(u + input-bias(u).bias)");
}

#[test]
fn a_loop_does_not_see_what_a_sensor_makes_of_its_output() {
    // The equation of motion uses the true value; only the reading changes.
    let text = "model M\n  input Real u;\n  output Real y;\nequation\n  der(y) = u - y;\nend M;\n";
    let found = rate(text, "", &[("sensor-gain", Some("y"), &[("gain", 2.0)])], "y (true)");
    assert_eq!(found, "u - y (true)");
}

#[test]
fn what_cannot_stand_somewhere_says_why() {
    let text = "model M\n  parameter Real m = 2;\n  input Real u;\n  output Real v;\n  Real x;\nequation\n  m*der(v) = u;\n  der(x) = 2*v;\nend M;\n";
    let flat = Flat::read(&Source::new("m.mo", text), &Options::default()).unwrap();
    let told = |sites: &str, kind: &str, at: Option<&str>, numbers: &[(&str, f64)]| {
        let file = Source::new("plant.toml", sites);
        let mut faults = rsm_core::source::Collector::new();
        let document = rsm_core::toml_reader::parse(&file, &mut faults).unwrap();
        let mut top = rsm_core::toml_reader::TableReader::document(&file, &document);
        let sites = top.optional("sites").map_or_else(Vec::new, |it| super::Site::read_all(&file, it, &mut faults));
        if let Err(faults) = faults.finish(Some(())) {
            return faults.to_string();
        }
        let catalogue = Catalogue::shipped();
        let placed = Placed {
            effect: catalogue.find(kind).unwrap(),
            at: at.map(str::to_string),
            numbers: numbers.iter().map(|(name, value)| ((*name).to_string(), *value)).collect(),
            source: file.clone(),
            place: 0..0,
        };
        extend(&flat, &sites, &[placed]).unwrap_err().to_string()
    };
    let body = |more: &str| format!("[sites.body]\nkind = \"translation\"\n{more}");
    let friction: Wanted<'_> = ("coulomb-friction", None, &[("force", 1.0)]);
    for (sites, (kind, at, numbers), wanted) in [
        (body("position = \"x\"\nspeed = \"v\"\n"), friction, "plant.toml:1:1: [sites.body]: `inertia` is missing"),
        (body("position = \"x\"\nspeed = \"w\"\ninertia = \"m\"\n"), friction, "plant.toml:4:10: `w` is not declared"),
        (body("position = \"x\"\nspeed = \"v\"\ninertia = \"m\"\n"), friction, "`v` is not the derivative of `x`"),
        (
            body("position = \"x\"\nspeed = \"v\"\ninertia = \"u\"\n"),
            friction,
            "no equation contains `der(v)` together with `u`",
        ),
        (String::new(), friction, "it needs a rotation or translation"),
        (String::new(), ("input-gain", Some("w"), &[("gain", 1.0)]), "it can stand at `u`"),
        (String::new(), ("input-gain", Some("u"), &[("gian", 1.0)]), "its numbers there are `gain`"),
        (String::new(), ("input-gain", Some("u"), &[]), "`gain` is missing"),
        (String::new(), ("sensor-lag", Some("v"), &[("time_constant", 0.0)]), "found 0, expected a number above 0"),
    ] {
        let found = told(&sites, kind, at, numbers);
        assert!(found.contains(wanted), "{found}\nwanted {wanted}");
    }
}

#[test]
fn what_the_shipped_sites_say_is_proposed_from_units_and_form() {
    let names = |plant: &str| -> Vec<String> {
        let list = super::propose(&flat(plant), &[]);
        list.iter()
            .map(|it| format!("{} {}", it.kind.name(), it.roles.iter().map(|it| it.1.as_str()).collect::<Vec<_>>().join(" ")))
            .collect()
    };
    assert_eq!(names("servo-axis#ServoAxis"), ["translation position speed mass"]);
    assert_eq!(
        names("driveline"),
        [
            "rotation engine_angle engine_speed engine_inertia",
            "rotation shaft_angle shaft_speed transmission_inertia + final_drive_inertia/(final_drive_ratio*final_drive_ratio)",
            "rotation wheel_angle wheel_speed wheel_inertia + mass*(wheel_radius*wheel_radius)",
            "joint clutch_twist clutch_rate clutch_torque",
            "joint driveshaft_twist driveshaft_rate driveshaft_torque",
        ]
    );
    assert_eq!(
        names("pmac"),
        [
            "winding current_d phase_resistance phase_inductance",
            "winding current_q phase_resistance phase_inductance",
            "rotation angle speed inertia",
        ]
    );
}

#[test]
fn a_proposal_can_be_pasted_and_says_no_more_once_it_is() {
    for plant in ["servo-axis#ServoAxis", "driveline", "pmac"] {
        let flat = flat(plant);
        let text: String = super::propose(&flat, &[]).iter().map(super::Proposal::toml).collect::<Vec<_>>().join("\n");
        let file = Source::new("plant.toml", text);
        let mut faults = rsm_core::source::Collector::new();
        let document = rsm_core::toml_reader::parse(&file, &mut faults).unwrap();
        let mut top = rsm_core::toml_reader::TableReader::document(&file, &document);
        let sites = super::Site::read_all(&file, top.optional("sites").unwrap(), &mut faults);
        faults.finish(Some(())).unwrap();
        extend(&flat, &sites, &[]).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(super::propose(&flat, &sites), []);
    }
}

#[test]
fn rooms_say_which_effects_a_site_has_the_roles_for() {
    let flat = flat("servo-axis#ServoAxis");
    let rooms = super::rooms(&flat, &sites_of("ServoAxis"), &Catalogue::shipped()).unwrap();
    let at = |name: &str| &rooms.iter().find(|it| it.at == name).unwrap().effects;
    assert!(at("carriage").contains(&"coulomb-friction".to_string()) && !at("carriage").contains(&"windage".to_string()));
    assert!(at("position").contains(&"sensor-lag".to_string()) && at("command").contains(&"input-delay".to_string()));
}

#[test]
fn an_effect_of_a_user_is_one_of_the_catalogue_and_its_faults_are_told_at_once() {
    let text = |kind: &str| {
        format!(
            "format = 1\nkind = \"{kind}\"\nsites = [\"input\"]\nsource = \"ours\"\n[changes.replace]\nsignal = \"2*signal\"\n[words]\nsentence = \"x\"\ncheck = \"y\"\n"
        )
    };
    let mut catalogue = Catalogue::shipped();
    catalogue.add(&[Source::new("twice.toml", text("twice"))]).unwrap();
    assert!(catalogue.find("twice").is_some());
    let again = catalogue.add(&[Source::new("again.toml", text("twice"))]).unwrap_err().to_string();
    assert!(again.contains("again.toml: the kind `twice` is in twice.toml already"), "{again}");
    let wrong = "format = 1\nkind = \"w\"\nsites = [\"inputs\"]\nsource = \"ours\"\n[numbers]\na = { unit = \"1\", mim = 0 }\n[changes]\neffort = \"2*(a\"\n[words]\nsentence = \"x\"\n";
    let told = Effect::read(&Source::new("w.toml", wrong)).unwrap_err().to_string();
    for words in ["w.toml:3:10", "which is no kind of site", "unknown key `mim`", "w.toml:8:15", "`check` is missing"] {
        assert!(told.contains(words), "{words}\n{told}");
    }
}

#[test]
fn faults_of_simpler_forms_are_at_their_places() {
    let file = |forms: &str| {
        let text = format!(
            "format = 1\nkind = \"bell-drag\"\nsites = [\"translation\"]\nsource = \"ours\"\n[numbers]\nlevel = {{ unit = \"N\" }}\n\
             {forms}\n[changes]\neffort = \"-level\"\n[words]\nsentence = \"It drags.\"\ncheck = \"Look.\"\n"
        );
        Effect::read(&Source::new("bell-drag.toml", text))
    };
    let told = |forms: &str| file(forms).unwrap_err().to_string();
    let found = told("[[forms]]\nis = \"special\"\ngiven = [\"height\"]\nsum = { coulomb-friction = \"level\" }");
    assert!(found.contains("bell-drag.toml:9:10") && found.contains("`height`, which is no number"), "{found}");
    let found = told("[[forms]]\nis = \"plain\"\nsum = { coulomb-friction = \"level\" }");
    assert!(found.contains("bell-drag.toml:8:6") && found.contains("special") && found.contains("alike"), "{found}");
    let found = told("[[forms]]\nis = \"special\"");
    assert!(found.contains("`sum`"), "{found}");
    // A name that is no number of the effect has no value.
    let whole = file("[[forms]]\nis = \"special\"\nsum = { coulomb-friction = \"height\" }").unwrap();
    assert!(whole.forms(&[("level", 2.0)]).is_err());
}

#[test]
fn limits_of_a_number_may_use_the_other_numbers_and_nothing_else() {
    let file = |limit: &str| {
        let text = format!(
            "format = 1\nkind = \"bell-drag\"\nsites = [\"translation\"]\nsource = \"ours\"\n[numbers]\nlevel = {{ unit = \"N\", {limit} }}\n\
             rest = {{ unit = \"N\" }}\n[changes]\neffort = \"-level - rest\"\n[words]\nsentence = \"It drags.\"\ncheck = \"Look.\"\n"
        );
        Effect::read(&Source::new("bell-drag.toml", text))
    };
    let drag = file("least = \"0.5*rest\", most = \"2*rest\"").unwrap();
    let possible = |level: f64| drag.are_possible(&[("level", level), ("rest", 4.0)]);
    assert!(possible(2.0) && possible(8.0) && !possible(1.9) && !possible(8.1));
    // Without the other number there is no limit.
    assert!(drag.are_possible(&[("level", 100.0)]));
    let told = file("most = \"2*speed\"").unwrap_err().to_string();
    assert!(told.contains("bell-drag.toml:6:") && told.contains("speed"), "{told}");
}
