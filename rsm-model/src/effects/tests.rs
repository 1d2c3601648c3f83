//! The catalogue and the rewriting, on plants whose equations are known.

use rsm_core::source::Source;

use super::{Catalogue, Placed, extend, sites_of};
use crate::flat::{Flat, Options};
use crate::shipped;
use crate::system::System;

fn flat(name: &str) -> Flat {
    let (name, model) = name.split_once('#').map_or((name, None), |(a, b)| (a, Some(b.to_string())));
    Flat::read(&shipped::text(name).unwrap(), &Options { model, parameters: Vec::new() }).unwrap()
}

/// The values of an effect that a test takes where any will do: inside all bounds.
fn numbers(effect: &super::Effect, kind: super::SiteKind) -> Vec<(String, f64)> {
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
                            "shapes the equations",
                            "not a name of the text",
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
    // Tanks and heat capacities are on none of the three.
    assert_eq!(nowhere, ["leak", "overflow", "radiation"]);
}

#[test]
fn every_guess_of_every_effect_has_a_value() {
    for effect in Catalogue::shipped().effects() {
        for kind in &effect.sites {
            let roles = kind.roles().iter().map(|it| (it.0, 0.5));
            let scales: Vec<(&str, f64)> = super::SCALES.iter().map(|it| (*it, 1.5)).chain(roles).collect();
            let starts = effect.starts(*kind, &scales).unwrap_or_else(|faults| panic!("{}: {faults}", effect.kind));
            for start in starts {
                for (name, value) in &start.numbers {
                    let number = effect.numbers_on(*kind).find(|it| it.name == *name).unwrap();
                    assert_eq!(number.refuses(*value), None, "{}: {name} = {value}", effect.kind);
                }
            }
        }
    }
}
