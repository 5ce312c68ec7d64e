//! Things: furniture and what lies on it, as part of the map.
//!
//! Answers: what stands where, how sure that is, and when it was seen last. A subscriber ([`Things`]) keeps small depth images with the boxes of
//! tracked objects, tied to keyframes; [`ThingMap`] is what comes of them at the poses of a map, and what a map file keeps. One module each for what is
//! gathered (`gather`, `look`), which points are a thing's own (`own`, `carve`, `claims`), where it is by its boxes alone (`bearings`), how far it can reach
//! (`scope`), its box (`upright`), what is level (`level`), which tracks are one thing (`merge`, `rest`), and what has been carried away (`absent`). People are never in it.

mod absent;
mod assign;
mod bearings;
mod beyond;
mod build;
mod bytes;
mod carve;
mod claims;
mod ends;
mod frames;
mod gather;
mod ground;
mod level;
mod look;
mod merge;
mod own;
mod part;
mod rest;
mod scope;
mod upright;

pub use bytes::ThingBytesError;
pub use gather::{Things, ThingsConfig};
pub use ground::Room;
pub use upright::UprightBox;

use crate::floor::Floor;
use ground::{RoomMap, Spot};
use part::{Record, World};
use std::collections::BTreeMap;
use stillpoint_detection::ClassId;
use stillpoint_map::{MapView, SubmapId};

/// A thing in a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Thing {
    /// What it is.
    pub class: ClassId,
    /// Where it is, and how large.
    pub bounds: UprightBox,
    /// Share of the looks at its place in which it was found, 0 to 1; it comes nearer to that share with every look.
    pub confidence: f64,
    /// Looks in which it was found; there are ten in a second, and five where memory was short.
    pub found: u32,
    /// The submap whose frame of reference its box is in.
    pub submap: SubmapId,
    /// The number of the room that it is in, as in [`ThingMap::rooms`]; none where the ground around it is not known.
    pub room: Option<u32>,
    /// Stamp of the first frame in which it was found, s.
    pub first_seen: f64,
    /// Stamp of the last one, s.
    pub last_seen: f64,
}

/// Things of less confidence are kept, but not said: they were seen too little so far.
const LEAST_CONFIDENCE: f64 = 0.2;
/// Things found in fewer looks are kept but not reported.
const LEAST_FOUND: u32 = 4;

/// What is known of the things in a map. Everything hangs on keyframes, so that it moves with them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThingMap {
    records: Vec<Record>,
    /// Where the floor is, by submap.
    levels: BTreeMap<SubmapId, Floor>,
    /// Where one can be, and where walls are.
    ground: Vec<Spot>,
}

impl ThingMap {
    /// The name of the extension of map files that it is kept in.
    pub const EXTENSION: &'static str = "stillpoint/things";

    /// The things where the map has them by now, in the order in which they were first seen. What hangs on keyframes that the map does not have is left out.
    #[must_use]
    pub fn list(&self, view: &MapView) -> Vec<Thing> {
        let world = World {
            view,
            levels: &self.levels,
        };
        let mut things: Vec<Thing> = self
            .records
            .iter()
            .filter(|r| r.found >= LEAST_FOUND && r.confidence() >= LEAST_CONFIDENCE)
            .filter_map(|r| r.thing(&world))
            .filter(|t| part::can_be(t.class, &t.bounds))
            .collect();
        let rooms = RoomMap::new(&self.ground, &self.levels, view);
        for thing in &mut things {
            thing.room = rooms.room(thing.submap, &thing.bounds.centre);
        }
        things.sort_by(|a, b| {
            let place = |t: &Thing| t.bounds.centre.x;
            let stamps = a.first_seen.total_cmp(&b.first_seen);
            stamps
                .then(a.class.0.cmp(&b.class.0))
                .then(place(a).total_cmp(&place(b)))
        });
        things
    }

    /// The things of two maps that were put together ([`stillpoint_slam::join_maps`]): `second` is of the map whose keyframe ids were raised by `added`, and
    /// `map` the joined one. What both know is one thing.
    #[must_use]
    pub fn joined(first: &Self, second: &Self, added: u32, map: &MapView) -> Self {
        build::join(first, second, added, map)
    }

    /// The rooms, submap by submap, in the order in which they were entered.
    #[must_use]
    pub fn rooms(&self, view: &MapView) -> Vec<Room> {
        RoomMap::new(&self.ground, &self.levels, view).rooms
    }

    /// Where the floor of a submap is, if it was seen.
    #[must_use]
    pub fn floor(&self, submap: SubmapId) -> Option<Floor> {
        self.levels.get(&submap).copied()
    }

    /// Whether nothing is known.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }
}
