//! Effects: physics that the equations of a plant may lack. Each effect is a file that changes the equations.
//!
//! ```text
//! effects/*.toml --file--> Effect      [sites] --site--> Site
//!         Flat + sites + placed effects --rewrite--> Extended (Flat, delays)
//! ```
//!
//! In: the equations of a plant, its sites, effects with their parameters there. Out: changed equations. No code here depends on the name of an
//! effect or a plant.

mod file;
mod forms;
mod guesses;
mod known;
mod offers;
mod propose;
mod rewrite;
mod shipped;
mod simpler;
mod site;
mod terms;

pub use file::{Effect, Number, TraceRole, Words};
pub use forms::FormKind;
pub use guesses::{SCALES, Start};
pub use offers::{Offer, Place, Places, RoleValue};
pub use propose::{Proposal, Room, propose, rooms};
pub use rewrite::{Delay, Extended, LateReading, Placed, extend};
pub use shipped::{Catalogue, shipped_file, sites_of};
pub use simpler::SimplerForm;
pub use site::{Site, SiteKind};

#[cfg(test)]
mod tests;
