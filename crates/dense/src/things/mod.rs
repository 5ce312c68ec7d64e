//! Objects in the map: furniture and items on it, with confidence and last detection.
//!
//! A subscriber ([`Things`]) keeps reduced depth images with the boxes of tracked objects, anchored to keyframes; [`ThingMap`] is the
//! result at the poses of a map, as stored in map files. One module each for collecting views (`gather`, `look`), the points of an object
//! (`own`, `carve`, `claims`), its location by boxes alone (`bearings`), its maximum size (`scope`), its box (`upright`), horizontal
//! surfaces (`level`), merging tracks (`merge`, `rest`), and removed objects (`absent`). People are excluded.

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

/// An object in a map.
#[derive(Clone, Debug, PartialEq)]
pub struct Thing {
    /// Its class.
    pub class: ClassId,
    /// Its bounding box.
    pub bounds: UprightBox,
    /// Share of the views at its place in which it was detected, 0 to 1; approaches that share with every view.
    pub confidence: f64,
    /// Number of views in which it was detected, at ten per second, or five when memory is short.
    pub found: u32,
    /// The submap of the box's frame of reference.
    pub submap: SubmapId,
    /// Number of its room, as in [`ThingMap::rooms`]; `None` if the ground around it is unknown.
    pub room: Option<u32>,
    /// Stamp of the first detection, s.
    pub first_seen: f64,
    /// Stamp of the last detection, s.
    pub last_seen: f64,
}

/// Minimum confidence of reported objects; others are kept but were seen too little.
const LEAST_CONFIDENCE: f64 = 0.2;
/// Minimum number of detections of reported objects.
const LEAST_FOUND: u32 = 4;

/// The objects of a map. All data are anchored to keyframes, and move with them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThingMap {
    records: Vec<Record>,
    levels: BTreeMap<SubmapId, Floor>,
    ground: Vec<Spot>,
}

impl ThingMap {
    /// Name of the extension in map files.
    pub const EXTENSION: &'static str = "stillpoint/things";

    /// The objects at the current poses of a map, in the order of first detection. Objects of keyframes that the map lacks are left out.
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

    /// The objects of two maps joined by [`stillpoint_slam::join_maps`]: `second` belongs to the map whose keyframe ids were raised by
    /// `added`, and `map` is the joined one. Common objects are merged.
    #[must_use]
    pub fn joined(first: &Self, second: &Self, added: u32, map: &MapView) -> Self {
        build::join(first, second, added, map)
    }

    /// The rooms, submap by submap, in the order in which they were entered.
    #[must_use]
    pub fn rooms(&self, view: &MapView) -> Vec<Room> {
        RoomMap::new(&self.ground, &self.levels, view).rooms
    }

    /// The floor of a submap, if it was seen.
    #[must_use]
    pub fn floor(&self, submap: SubmapId) -> Option<Floor> {
        self.levels.get(&submap).copied()
    }

    /// Whether it holds no data.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }
}
