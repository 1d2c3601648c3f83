//! Whole diagnoses from a selection that is made by hand: which figure goes where.

use super::super::super::known_loop::{GainEstimate, KnownLoop};
use super::*;

const DRIFT: &str = "[[effects]]\nkind = \"sensor-drift\"\nparameters = { output = \"position\", rate = 0.01 }\n";

/// An axis with dry friction and a drift of its sensor: its file, the records, records that no fit has seen, the nominal plant.
fn axis() -> (PlantFile, WhitenedResiduals, WhitenedResiduals, Model) {
    let file = axis_under_steps::file("mass = 0.02", "");
    let truth = axis_under_steps::file("mass = 0.02", &(axis_under_steps::friction(0.8) + DRIFT));
    let (whitened, nominal) = axis_under_steps::whitened(&file, &truth, true);
    let (mut unseen, _) = axis_under_steps::whitened(&file, &truth, false);
    // The same motion with other noise: that of the first record, the last row first.
    let noise = |row: usize| whitened.records[0].measured(0)[row] - unseen.records[0].measured(0)[row];
    let measured = unseen.records[0].measured(0).iter().enumerate().map(|(row, value)| value + noise(599 - row)).collect();
    unseen.records[0].record.measured[0] = Some(measured);
    (file, whitened, unseen, nominal)
}

/// What a search would say that believes the effects, one cause each.
fn selection(whitened: &WhitenedResiduals, nominal: &Model, effects: &str, causes: Vec<AcceptedCause>) -> Selection {
    let effects = axis_under_steps::file("mass = 0.02", effects).effects;
    Selection {
        calibrated: levenberg::fit(whitened, nominal.clone(), 8).unwrap(),
        fit: levenberg::fit(whitened, nominal.with_effects(nominal, effects), 8).unwrap(),
        causes,
        refused: Vec::new(),
        threshold: 30.0,
        ranking: Vec::new(),
        remaining: Vec::new(),
        stopped: None,
        known_loop: None,
        all_rows: None,
        numbers: None,
    }
}

#[test]
fn causes_that_leave_noise_are_told_with_all_their_figures() {
    let (file, whitened, unseen, nominal) = axis();
    let mut causes = vec![
        accepted("coulomb-friction", 2e5, &[("backlash", 10.0), ("asymmetric-friction", 0.0)], &nominal),
        accepted("sensor-drift position", 9e5, &[("sensor-bias position", 2.0)], &nominal),
    ];
    causes[0].rival_models = vec![("backlash".to_string(), nominal.clone())];
    causes[1].rival_models = vec![("sensor-bias position".to_string(), nominal.clone())];
    let selection = selection(&whitened, &nominal, &(axis_under_steps::friction(0.5) + DRIFT), causes);
    let found = conclude(&file, &whitened, &unseen, &nominal, selection, Vec::new(), &[(0, 1e-9)]);
    assert_eq!(found.verdict, Verdict::Explained);
    // Rounding has a gain of one a row, of 600.
    let told: Vec<_> = found.causes.iter().map(|it| (it.kind, it.gain)).collect();
    assert_eq!(told, [("sensor-drift", 9e5), ("coulomb-friction", 2e5), ("sensor-quantisation", 600.0)]);
    assert_eq!((found.helpers.len(), found.practical), (0, None));
    assert_eq!(found.causes[1].indistinguishable_from, ["backlash"]);
    let aliases: Vec<_> = found.aliases.iter().map(|it| it.rival.as_str()).collect();
    assert_eq!(aliases, ["sensor-bias position", "backlash"]);
    let entries: Vec<_> = found.plant.effects.iter().map(|it| it.description.kind).collect();
    assert_eq!(entries, ["coulomb-friction", "sensor-drift", "sensor-quantisation"]);
    // On holdout records nothing is left, all is gained, and the interval holds the gain.
    assert!(
        found.left_unseen.as_ref().is_some_and(|it| it.excess.to_bits() == 0) && found.left.excess.to_bits() == 0,
        "0, not -0"
    );
    let (low, high) = found.gain_interval;
    assert!(found.gain > 0.99 && low <= found.gain && found.gain <= high && low > 0.9, "{} {low} {high}", found.gain);
    assert!(found.error_breakdown.unseen && !found.error_breakdown.slices.is_empty());
    assert!(found.causes[0].contribution.is_some() && found.causes[1].contribution.is_some());
    assert_eq!(found.noise.iter().map(|it| it.0).collect::<Vec<_>>(), [0]);
}

#[test]
fn a_cause_beside_structure_helps_and_what_the_law_shows_takes_its_place() {
    let (file, whitened, _, nominal) = axis();
    let nothing = whitened.with_records(Vec::new());
    let of = |gain: f64, known_loop: Option<KnownLoop>| {
        let causes = vec![accepted("sensor-drift position", gain, &[], &nominal)];
        let selection = Selection { known_loop, ..selection(&whitened, &nominal, DRIFT, causes) };
        let rows = selection.fit.residual.len();
        let unit = effect_size::deciding_difference(selection.threshold, selection.fit.cost, rows);
        (conclude(&file, &whitened, &nothing, &nominal, selection, Vec::new(), &[]), rows as f64, unit)
    };
    let (found, rows, unit) = of(1e4, None);
    assert_eq!(found.verdict, Verdict::Unexplained);
    let [drift] = &found.helpers[..] else { panic!("{:?}", found.causes) };
    assert!(found.left.excess > 1.0 && found.left_unseen.is_none() && !found.error_breakdown.unseen);
    // The worst of what is left, over all rows, stands beside its gain.
    let left = found.predicted.as_ref().map_or(found.left.excess, |it| it.excess.max(found.left.excess));
    let case = Evidence {
        gain: 1e4,
        rivals: &[],
        same: unit,
        not_fitted: 0,
        left: left * rows,
        explained: false,
        rivals_tested: true,
    };
    assert_eq!(drift.confidence, confidence::confidence(&case).own);
    assert!(drift.confidence > 0.0 && drift.confidence < LEAST_CONFIDENCE, "{}", drift.confidence);
    // A gain of the command by the law alone: a cause and an entry of its own.
    let right = GainEstimate { value: 1.0, low: 0.99, high: 1.01 };
    let off = GainEstimate { value: 0.9, low: 0.89, high: 0.91 };
    let known = KnownLoop { position: right, command: off, late: 0, stated: 1.0, left: 0.1, size: 1.0 };
    let (found, ..) = of(1e4, Some(known));
    let told = |list: &[Cause]| list.iter().map(|it| it.kind).collect::<Vec<_>>();
    assert_eq!((told(&found.causes), told(&found.helpers)), (vec!["sensor-gain"], vec!["sensor-drift"]));
    assert_eq!(found.plant.effects.iter().map(|it| it.description.kind).collect::<Vec<_>>(), ["sensor-drift", "sensor-gain"]);
}

#[test]
fn what_was_not_believed_has_the_first_reason_that_holds() {
    use super::super::super::final_test::Refusal;
    use super::super::super::rejected::Reason;
    let (file, whitened, unseen, nominal) = axis();
    let causes = vec![
        accepted("coulomb-friction", 2e5, &[("backlash", 10.0), ("ripple", 900.0)], &nominal),
        accepted("sensor-drift:position", 9e5, &[], &nominal),
    ];
    let mut selection = selection(&whitened, &nominal, &(axis_under_steps::friction(0.5) + DRIFT), causes);
    let list = |list: &[(&str, f64)]| list.iter().map(|(name, gain)| ((*name).to_string(), *gain)).collect();
    // An accepted cause is not rejected, and a cause must gain 30.
    selection.ranking = list(&[
        ("coulomb-friction", 1e5),
        ("refused", 5e4),
        ("backlash", 4e4),
        ("ripple", 3e4),
        ("taken", 2e4),
        ("unkept", 1e4),
        ("little", 29.0),
    ]);
    selection.remaining = list(&[("taken", 3.0), ("unkept", 500.0)]);
    selection.refused = vec![Refusal { cause: "refused".to_string(), why: "it is worse".to_string() }];
    let found = conclude(&file, &whitened, &unseen, &nominal, selection, Vec::new(), &[]);
    let rejected = found.rejected();
    let told: Vec<(&str, &Reason)> = rejected.iter().map(|it| (it.label.as_str(), &it.why)).collect();
    let friction = || "coulomb-friction".to_string();
    let expected = [
        ("refused", Reason::Refused("it is worse".to_string())),
        ("backlash", Reason::Confounded(friction())),
        ("ripple", Reason::FitsWorse { cause: friction(), by: 900.0 }),
        ("taken", Reason::Explained(3.0)),
        ("unkept", Reason::NotKept),
        ("little", Reason::LowPredictedGain),
    ];
    assert_eq!(told, expected.iter().map(|(name, why)| (*name, why)).collect::<Vec<_>>());
    assert_eq!((rejected[4].predicted_gain, rejected[4].remaining, rejected[5].remaining), (1e4, Some(500.0), None));
}
