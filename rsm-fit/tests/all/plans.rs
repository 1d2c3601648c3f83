//! Plans: from specification to CSV and back, and refused files.
//!
//! `cases/rejected-plans/NAME.toml` is a design specification, `NAME.csv` a plan; `NAME.txt` is the whole message. `RSM_BLESS=1` rewrites the
//! messages; the difference is reviewed like code.

use std::collections::BTreeSet;
use std::path::Path;

use rsm_core::source::Source;
use rsm_fit::plan::{Alpha, DesignSpecification, Experiment, Factor, Plan};

use crate::refused::{ACCEPTED, assert_beside, files};

fn made(text: &str) -> Plan {
    Plan::make(&DesignSpecification::from_source(Source::new("plan.toml", text)).unwrap()).unwrap()
}

fn points(plan: &Plan) -> Vec<Vec<f64>> {
    (0..plan.runs.len()).map(|row| plan.factors.iter().map(|factor| factor.values[row]).collect()).collect()
}

/// The dynamometer of the paper: 10 depths, 18 advances.
const DYNAMOMETER: &str = "format = 1\nplan = \"dynamometer\"\nseed = 7\n\
    [factors.depth]\nunit = \"%\"\nlevels = { from = 10, to = 100, step = 10 }\n\
    [factors.advance]\nunit = \"deg\"\nlevels = { from = 0, to = 170, step = 10 }\n";

#[test]
fn a_full_factorial_runs_every_combination_once_in_an_order_that_the_seed_decides() {
    let plan = made(DYNAMOMETER);
    assert_eq!((plan.runs.len(), plan.points()), (180, 180));
    assert_eq!(plan.runs, (1..=180).collect::<Vec<u32>>());
    let all: BTreeSet<(u32, u32)> = points(&plan).iter().map(|point| (point[0] as u32, point[1] as u32)).collect();
    let expected = (1..=10).flat_map(|depth| (0..18).map(move |advance| (10 * depth, 10 * advance))).collect();
    assert_eq!(all, expected);
    assert_eq!(made(DYNAMOMETER).csv(), plan.csv());
    let other = made(&DYNAMOMETER.replace("seed = 7", "seed = 8"));
    assert_ne!(other.csv(), plan.csv());
    // The stream of ChaCha8 and the shuffle are fixed: these bytes are the same on every machine and in every release.
    assert!(plan.csv().starts_with(FIRST_LINES), "{}", &plan.csv()[..80]);
}

const FIRST_LINES: &str = "run[1],depth[%],advance[deg]\n1,60,10\n2,100,130\n3,30,170\n";

#[test]
fn the_order_of_runs_is_not_the_order_of_a_factor() {
    // The rank correlation of run and setting: 0 with a standard deviation of 1/sqrt(179) = 0.075 in a random order, 0.99 in standard order. The
    // limit of 0.3 is 4 standard deviations.
    for factor in &made(DYNAMOMETER).factors {
        let n = factor.values.len() as f64;
        let mean = factor.values.iter().sum::<f64>() / n;
        let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
        for (k, value) in factor.values.iter().enumerate() {
            let (x, y) = (k as f64 - (n - 1.0) / 2.0, value - mean);
            (xy, xx, yy) = (xy + x * y, xx + x * x, yy + y * y);
        }
        assert!((xy / (xx * yy).sqrt()).abs() < 0.3, "{}", factor.name);
    }
}

#[test]
fn blocks_are_united_and_shared_points_run_once() {
    let plan =
        made(&format!("{DYNAMOMETER}[[blocks]]\ndepth = [10, 70]\n[[blocks]]\ndepth = [70, 80]\nadvance = [0, 90, 170]\n"));
    // 2 x 18, and 80 at 3 advances: 70 at these 3 advances is already in the first block.
    assert_eq!((plan.runs.len(), plan.points()), (39, 39));
}

#[test]
fn replicates_conditions_and_centre_points() {
    let text = format!(
        "replicates = 2\ncentre_points = 3\nwhere = [{{ sum = {{ depth = 1, advance = 1 }}, at_most = 140 }}]\n{DYNAMOMETER}"
    );
    let plan = made(&text);
    // A depth of 10 to 100 leaves advances 0 to 130, 120, ... 40: 14 + 13 + ... + 5 = 95 points, twice.
    assert_eq!((plan.runs.len(), plan.points()), (2 * 95 + 3, 96));
    let centre = [55.0, 85.0];
    let at: Vec<usize> = (0..193).filter(|row| points(&plan)[*row] == centre).collect();
    assert_eq!(at, [0, 96, 192]);
    assert!(points(&plan).iter().all(|point| point[0] + point[1] <= 140.0));
}

#[test]
fn coded_designs_stand_in_physical_units() {
    let factors = "[factors.speed]\nunit = \"rad/s\"\nrange = [100, 300]\n[factors.torque]\nunit = \"N*m\"\nrange = [-5, 5]\n";
    let composite = |alpha: &str| {
        let head = "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"central-composite\"\ncentre_points = 5\n";
        made(&format!("{head}alpha = {alpha}\n{factors}"))
    };
    let rotatable = composite("\"rotatable\"");
    assert_eq!((rotatable.runs.len(), rotatable.points()), (13, 9));
    let far = 200.0 + 100.0 * 2f64.sqrt();
    // Two roundings of a value near 341.
    assert!(points(&rotatable).iter().any(|point| (point[0] - far).abs() < 1e-12 && point[1] == 0.0));
    assert!(points(&composite("\"face-centred\"")).contains(&vec![300.0, 0.0]));
    assert!(points(&composite("1.5")).contains(&vec![200.0, -7.5]));
    let head = "format = 1\nplan = \"p\"\nseed = 1\nruns = 20\n";
    for design in ["latin-hypercube", "random"] {
        let plan =
            made(&format!("{head}design = \"{design}\"\nwhere = [{{ sum = {{ torque = 1 }}, at_least = 0 }}]\n{factors}"));
        assert_eq!((plan.runs.len(), plan.points()), (20, 20), "{design}");
        assert!(points(&plan).iter().all(|point| (100.0..=300.0).contains(&point[0]) && (0.0..=5.0).contains(&point[1])));
    }
    let third = "[factors.load]\nunit = \"kg\"\nrange = [0, 320]\n";
    let behnken =
        made(&format!("format = 1\nplan = \"p\"\nseed = 1\ndesign = \"box-behnken\"\ncentre_points = 3\n{factors}{third}"));
    assert_eq!((behnken.runs.len(), behnken.points()), (15, 13));
}

#[test]
fn as_many_runs_as_asked_for_or_a_word_why_not() {
    let head = "format = 1\nplan = \"p\"\nruns = 40\n[factors.a]\nunit = \"1\"\nrange = [0, 1]\n[factors.b]\nunit = \"1\"\nrange = [0, 1]\n";
    for seed in 1..12 {
        for design in ["latin-hypercube", "random"] {
            // The region shrinks from the whole box to a triangle with a share of 1/240.
            let bound = 1.0 / f64::from(seed);
            let text = format!(
                "seed = {seed}\ndesign = \"{design}\"\nwhere = [{{ sum = {{ a = 1, b = 1 }}, at_most = {bound} }}]\n{head}"
            );
            let plan = made(&text);
            assert_eq!((plan.runs.len(), plan.points()), (40, 40), "{design}, seed {seed}");
            assert!(points(&plan).iter().all(|point| point[0] + point[1] <= bound));
            assert_eq!(made(&text).csv(), plan.csv());
        }
    }
    // A very thin region contains a point of a factorial design, and hardly any random point.
    for design in ["latin-hypercube", "random"] {
        let text = format!("seed = 1\ndesign = \"{design}\"\nwhere = [{{ sum = {{ a = 1 }}, at_most = 1e-4 }}]\n{head}");
        let specification = DesignSpecification::from_source(Source::new("plan.toml", text)).unwrap();
        match Plan::make(&specification) {
            Ok(plan) => assert_eq!(plan.runs.len(), 40),
            Err(faults) => assert!(faults.to_string().contains("`where`: "), "{faults}"),
        }
    }
}

#[test]
fn points_that_fall_away_are_counted_or_the_plan_is_refused() {
    // The box is cut by random half-spaces. A plan reports how many points of its design are missing, or why it is not possible.
    fn factor(name: &str) -> String {
        format!("[factors.{name}]\nunit = \"1\"\nrange = [-1, 1]\n")
    }
    fn levels(name: &str) -> String {
        format!("[factors.{name}]\nunit = \"1\"\nlevels = [-1, 0, 1]\n")
    }
    let mut random = rsm_fit::random::Random::new(4);
    let (mut whole, mut less, mut refused) = (0, 0, 0);
    for round in 0..120 {
        let (design, more, all) = [
            ("central-composite", "alpha = \"face-centred\"\ncentre_points = 0\n", 14),
            ("box-behnken", "centre_points = 0\n", 12),
            ("full-factorial", "", 27),
        ][round % 3];
        let sections =
            ["a", "b", "c"].map(if design == "full-factorial" { levels as fn(&str) -> String } else { factor }).concat();
        let [a, b, c] = [(); 3].map(|()| 2.0 * random.share() - 1.0);
        let bound = 3.0 * random.share() - 0.5;
        let text = format!(
            "format = 1\nplan = \"p\"\nseed = 1\ndesign = \"{design}\"\n{more}\
             where = [{{ sum = {{ a = {a}, b = {b}, c = {c} }}, at_most = {bound} }}]\n{sections}"
        );
        let specification = DesignSpecification::from_source(Source::new("plan.toml", text)).unwrap();
        match Plan::make(&specification) {
            Ok(plan) => match &plan.kept {
                None => {
                    whole += 1;
                    assert_eq!(plan.runs.len(), all, "{design}");
                }
                Some(kept) => {
                    less += 1;
                    assert_eq!((kept.of, kept.points), (all, plan.runs.len()), "{design}");
                    assert!(kept.points < all && kept.correlation[0] < 1e-14);
                    // At least as many points as terms.
                    assert!(kept.points >= if design == "full-factorial" { 4 } else { 9 }, "{design}: {kept:?}");
                }
            },
            Err(faults) => {
                refused += 1;
                let words = faults.to_string();
                assert!(words.contains("cannot be estimated from them") || words.contains("no point of the design"), "{words}");
            }
        }
    }
    assert!(whole > 10 && less > 10 && refused > 10, "{whole} {less} {refused}");
}

#[test]
fn a_plan_is_read_back_as_it_was_written_and_in_other_units() {
    let plan = made(&format!("replicates = 2\n{DYNAMOMETER}"));
    let read = Plan::read(&Source::new("plan.csv", plan.csv())).unwrap();
    assert_eq!((&read.runs, &read.factors), (&plan.runs, &plan.factors));
    assert_eq!(read.csv(), plan.csv());
    let radians = read.settings("advance", "rad").unwrap();
    for (found, degrees) in radians.iter().zip(&read.factors[1].values) {
        // The expected value has one rounding, the result at most three.
        let expected = degrees.to_radians();
        assert!((found - expected).abs() <= 2.0 * f64::EPSILON * expected, "{found} {expected}");
    }
    let fault = read.settings("speed", "rad/s").unwrap_err();
    assert_eq!(fault.to_string(), "plan.csv:1: the plan has no factor `speed`\n  help: its factors are `depth`, `advance`");
    let fault = read.settings("depth", "m").unwrap_err();
    assert_eq!(fault.to_string(), "plan.csv:1: factor `depth`: `%` cannot be converted to `m`: they measure different things");
    assert_eq!(read.fault(2, "the gear is not 1 to 5").to_string(), "plan.csv:4: the gear is not 1 to 5");
    // Rows may be removed; the run numbers of the others do not change.
    let sparse = Plan::read(&Source::new("plan.csv", "run[1],gear[1]\n2,1\n7,1\n")).unwrap();
    assert_eq!(sparse.runs, [2, 7]);
}

#[test]
fn every_bad_plan_gets_the_message_beside_it() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases/rejected-plans");
    let names = files(&folder, &["toml", "csv"]);
    assert!(names.len() >= 16, "{} cases", names.len());
    let case = |file: String| {
        let source = Source::new(&file, std::fs::read_to_string(folder.join(&file)).unwrap());
        let (name, ending) = file.rsplit_once('.').unwrap();
        let plan = match ending {
            "toml" => DesignSpecification::from_source(source).and_then(|specification| Plan::make(&specification)),
            _ => Plan::read(&source),
        };
        let found = plan.map_or_else(|faults| faults.to_string(), |plan| format!("{ACCEPTED}: {plan:?}"));
        (format!("{name}.txt"), found)
    };
    assert_beside(&folder, names.into_iter().map(case));
}

#[test]
fn mutilated_plans_are_refused_without_a_panic() {
    let good = format!(
        "replicates = 2\ncentre_points = 1\nwhere = [{{ sum = {{ depth = 1 }}, at_most = 90 }}]\n{DYNAMOMETER}[[blocks]]\ndepth = [10]\n"
    );
    let plan = made(&good).csv();
    for (text, is_plan) in [(&good, false), (&plan, true)] {
        for at in 0..text.len().min(600) {
            for bytes in [text[..at].to_string(), [&text[..at], &text[at + 1..]].concat()] {
                let source = Source::new("p", bytes);
                if is_plan {
                    let _ = Plan::read(&source);
                } else {
                    let _ = DesignSpecification::from_source(source).and_then(|specification| Plan::make(&specification));
                }
            }
        }
    }
}

#[test]
fn a_design_in_memory_is_the_plan_of_its_specification() {
    let ranges = || ["a", "b", "c"].map(|name| Factor::within(name, "rad/s", [-2.0, 6.0]));
    let sections = |key: &str| ["a", "b", "c"].map(|name| format!("[factors.{name}]\nunit = \"rad/s\"\n{key}\n")).concat();
    let range = sections("range = [-2.0, 6.0]");
    let levels = || ["a", "b", "c"].map(|name| Factor::at(name, "rad/s", [-2.0, 0.0, 6.0]));
    let cases = [
        (
            "design = \"central-composite\"\nalpha = \"rotatable\"\ncentre_points = 4\nreplicates = 2",
            &range,
            Experiment::central_composite(ranges(), Alpha::Rotatable).centre_points(4).replicates(2),
        ),
        (
            "design = \"central-composite\"\nalpha = 1.5\ncentre_points = 0\nwhere = [{ sum = { a = 1.0, b = 1.0 }, at_most = 11.0 }]",
            &range,
            Experiment::central_composite(ranges(), Alpha::At(1.5)).at_most([("a", 1.0), ("b", 1.0)], 11.0),
        ),
        ("design = \"box-behnken\"\ncentre_points = 3", &range, Experiment::box_behnken(ranges()).centre_points(3)),
        (
            "design = \"latin-hypercube\"\nruns = 30\nwhere = [{ sum = { c = 1.0 }, at_least = 0.0 }]",
            &range,
            Experiment::latin_hypercube(ranges(), 30).at_least([("c", 1.0)], 0.0),
        ),
        ("design = \"random\"\nruns = 12", &range, Experiment::random(ranges(), 12)),
        ("", &sections("levels = [-2, 0, 6]"), Experiment::full_factorial(levels())),
        (
            "blocks = [{ a = [0] }, { b = [1, 2], c = [-0.0] }]",
            &sections("levels = [-2, 0, 6]"),
            Experiment::full_factorial(levels()).block([("a", [0.0])]).block([("b", vec![1.0, 2.0]), ("c", vec![-0.0])]),
        ),
    ];
    for (head, factors, experiment) in cases {
        let text = format!("format = 1\nplan = \"p\"\nseed = 7\n{head}\n{factors}");
        let specification =
            DesignSpecification::from_source(Source::new("plan.toml", text)).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!(experiment.seed(7).plan().unwrap(), Plan::make(&specification).unwrap(), "{head}");
    }
}

#[test]
fn a_design_in_memory_that_cannot_be_made_is_told_in_words() {
    let one = || [Factor::within("a", "1", [0.0, 1.0])];
    let cases = [
        (Experiment::random([], 3), "`factors`: found none, expected at least one"),
        (Experiment::random([Factor::within("run", "1", [0.0, 1.0])], 3), "factor name `run` is taken"),
        (Experiment::random([Factor::within("a", "parsnip", [0.0, 1.0])], 3), "factor `a`: `unit`: "),
        (Experiment::random([Factor::within("a", "1", [0.0, f64::NAN])], 3), "factor `a`: `range`: found [0, NaN]"),
        (Experiment::random([Factor::at("a", "1", [0.0, 1.0])], 3), "factor `a`: levels belong to the full factorial only"),
        (Experiment::full_factorial(one()), "factor `a`: `levels`: found none, expected at least one"),
        (Experiment::full_factorial([Factor::at("a", "1", [0.0, -0.0])]), "factor `a`: `levels`: 0 occurs twice"),
        (Experiment::full_factorial([Factor::at("a", "1", [0.0])]).block([("b", [1.0])]), "block 1: there is no factor `b`"),
        (Experiment::full_factorial([Factor::at("a", "1", [0.0])]).block([("a", [])]), "block 1: `a`: `levels`: found none"),
        (Experiment::central_composite(one(), Alpha::At(0.0)), "`alpha`: found 0, expected a number above 0"),
        (Experiment::box_behnken(one()), "\"box-behnken\" has 3 to 7 factors, found 1"),
        (Experiment::random(one(), 0), "`runs`: found 0, expected a whole number from 1"),
        (Experiment::random(one(), 100_001), "the plan has up to 100001 runs, at most 100000 are accepted"),
        (Experiment::random(one(), 3).replicates(0), "`replicates`: found 0"),
        (Experiment::random(one(), 3).at_most([("b", 1.0)], 1.0), "condition 1: there is no factor `b`"),
        (Experiment::random(one(), 3).at_most([("a", f64::NAN)], 1.0), "condition 1: found NaN, expected a finite number"),
        (
            Experiment::central_composite(one(), Alpha::Rotatable).at_most([("a", 1.0)], -9.0),
            "`where`: no point of the design fulfils it",
        ),
    ];
    for (experiment, expected) in cases {
        let faults = experiment.plan().unwrap_err().to_string();
        assert!(faults.contains(&format!("design: {expected}")), "expected {expected}, found\n{faults}");
    }
}
