//! The magnitudes of the quantities at a plant's sites along records: the scales of first guesses.
//!
//! In: a plant file, records. Out: [`Scales`] for each place. This file only computes magnitudes; it does not decide between causes.

use rsm_core::order;
use rsm_core::source::Faults;
use rsm_model::effects::SiteKind;
use rsm_model::expression::Id;
use rsm_model::system::System;

use super::{plant_of, run};
use crate::effect::Scales;
use crate::plant_file::PlantFile;
use crate::record::Record;

/// The role of a position at a site, by its names.
const POSITIONS: [&str; 4] = ["position", "twist", "level", "temperature"];

/// The least span of a position, as a share of its largest magnitude. A number divided by the span then stays finite where nothing moves.
const LEAST_SPAN: f64 = 1e-3;

/// Magnitudes at each place of a plant of equations along records: the roles of sites, and the scales that files of effects name. Records that the
/// plant cannot follow are omitted.
///
/// # Errors
/// Sites that do not agree with the equations.
pub fn scales(file: &PlantFile, records: &[&Record]) -> Result<Vec<Scales>, Faults> {
    let kind = records.first().map_or(file.kind, |record| file.kind.driven_by(record.drive)).0;
    let plant = plant_of(kind);
    let mut sums: Vec<Vec<Vec<[f64; 2]>>> = Vec::new();
    for record in records {
        // Records with and without the controller have different places; those like the first record count.
        let Some(of_record) =
            Some(record).filter(|it| file.kind.driven_by(it.drive).0 == kind).and_then(|it| along(file, it).ok())
        else {
            continue;
        };
        sums.push(of_record);
    }
    let ends = |place: usize, part: usize| {
        // What a record does not show has no ends there: its first one is above the second.
        let shown = sums.iter().map(|it| it[place][part]).filter(|[lowest, highest]| lowest <= highest);
        order::ends(shown.flatten())
    };
    let most = |place: usize, part: usize| match ends(place, part) {
        (lowest, highest) if lowest <= highest => lowest.abs().max(highest.abs()),
        _ => 0.0,
    };
    let mut list = Vec::new();
    for (k, place) in plant.places.iter().enumerate() {
        let mut sizes = Vec::new();
        match place.kind {
            SiteKind::Input => {
                let at = kind.inputs.iter().position(|it| it.name == place.at);
                let values = records.iter().filter_map(|it| it.inputs.get(at?)).flatten();
                let recorded = Some(order::ends(values)).filter(|(lowest, highest)| lowest <= highest);
                // A signal inside of the plant, such as the command of its controller, is simulated.
                let simulated = (0..place.roles.len()).map(|part| most(k, part)).fold(0.0, f64::max);
                let (lowest, highest) = match at {
                    Some(_) => recorded.unwrap_or((0.0, 0.0)),
                    None => (-simulated, simulated),
                };
                let largest = lowest.abs().max(highest.abs());
                let named =
                    [("input_scale", largest), ("signal", largest), ("input_lowest", lowest), ("input_highest", highest)];
                sizes.extend(named.map(|(name, value)| (name.to_string(), value)));
            }
            SiteKind::Output | SiteKind::Parameter | SiteKind::State => {}
            _ => {
                for (part, role) in place.roles.iter().enumerate() {
                    sizes.push((role.role.clone(), most(k, part)));
                }
                of_site(most(k, place.roles.len()), &mut sizes);
                let part = POSITIONS.iter().find_map(|name| place.roles.iter().position(|it| it.role == *name));
                // A position that is not finite in any record has no ends.
                let of_part = part.map(|part| (ends(k, part), most(k, part))).filter(|it| it.0.0 <= it.0.1);
                if let Some(((lowest, highest), largest)) = of_part {
                    let span = (highest - lowest).max(LEAST_SPAN * largest);
                    sizes.extend(
                        [("position_lowest", lowest), ("position_span", span)].map(|(name, it)| (name.to_string(), it)),
                    );
                }
            }
        }
        list.push(Scales { at: place.at.clone(), sizes });
    }
    Ok(list)
}

/// Adds the scales of a site. `term` is the largest term of its balance.
fn of_site(term: f64, sizes: &mut Vec<(String, f64)>) {
    let of = |name: &str| sizes.iter().find(|it| it.0 == name).map(|it| it.1);
    let first = |names: &[&str]| names.iter().find_map(|name| of(name));
    let mut more = Vec::new();
    let effort = if term > 0.0 { Some(term) } else { of("effort") };
    more.extend(effort.map(|it| ("effort_scale", it)));
    more.extend(first(&["speed", "rate", "road_speed"]).map(|it| ("speed_scale", it)));
    more.extend(first(&POSITIONS).map(|it| ("position_scale", it)));
    if let Some(current) = of("currents") {
        more.extend([("reading_scale", current), ("position_scale", current)]);
        more.extend(of("resistance").map(|it| ("loss_scale", it * current * current)));
    }
    if let Some(voltage) = of("voltages") {
        more.push(("input_scale", voltage));
        if term == 0.0 {
            more.push(("effort_scale", voltage));
        }
    }
    sizes.extend(more.into_iter().map(|(name, value)| (name.to_string(), value)));
}

/// Along a record: for each place, the lowest and the highest value of each role, then of the terms of the balance.
fn along(file: &PlantFile, record: &Record) -> Result<Vec<Vec<[f64; 2]>>, Faults> {
    // Sites belong to the equations without effects, so these equations are run.
    let (whole, machine, points) = run::without_effects(file, record)?;
    let places = whole.places_of_effects()?;
    let mut system = System::new(&places.flat)?;
    let mut expressed = |list: &[Id]| -> Vec<Id> { list.iter().map(|id| system.expressed(*id)).collect() };
    let groups: Vec<Vec<Id>> = places
        .list
        .iter()
        .flat_map(|place| place.roles.iter().map(|it| it.parts.clone()).chain([place.terms.clone()]))
        .map(|list| expressed(&list))
        .collect();
    let all: Vec<Id> = groups.iter().flatten().copied().collect();
    let mut ends = vec![[f64::INFINITY, f64::NEG_INFINITY]; groups.len()];
    for values in machine.evaluated_at(&whole, &system, &all, &points)? {
        let mut rest = &values[..];
        for (group, [lowest, highest]) in groups.iter().zip(&mut ends) {
            let (own, further) = rest.split_at(group.len());
            rest = further;
            for value in own.iter().filter(|it| it.is_finite()) {
                (*lowest, *highest) = (lowest.min(*value), highest.max(*value));
            }
        }
    }
    let mut rest = ends.into_iter();
    Ok(places.list.iter().map(|place| rest.by_ref().take(place.roles.len() + 1).collect()).collect())
}
