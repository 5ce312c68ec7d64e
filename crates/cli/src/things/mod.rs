//! Objects in a map: `map objects` and `things.json`.

use crate::args::map::MapObjectsArgs;
use crate::console;
use crate::failure::{Failure, Status};
use crate::map::{file, kept};
use serde::Serialize;
use stillpoint::dense::{Room, Thing, ThingMap};
use stillpoint::geometry::Vec3;
use stillpoint::map::Extension;
use stillpoint::slam::JoinedMaps;

/// The map file extension with the objects of two merged maps; `None` if neither has any.
pub(crate) fn joined(known: [Option<ThingMap>; 2], maps: &JoinedMaps) -> Option<Extension> {
    if known.iter().all(Option::is_none) {
        return None;
    }
    let [first, second] = known.map(Option::unwrap_or_default);
    let map = ThingMap::joined(&first, &second, maps.added, maps.map.view());
    Some(Extension {
        name: ThingMap::EXTENSION.to_owned(),
        bytes: map.to_bytes(),
    })
}

#[derive(Debug, Serialize)]
struct ThingJson {
    class: &'static str,
    /// m, world.
    centre: [f64; 3],
    /// Along its own axes, of which the third is up, m.
    size: [f64; 3],
    /// Rotation from its own axes to the world's, row by row.
    world_from_box: [[f64; 3]; 3],
    confidence: f64,
    /// Number of views in which it was found.
    found: u32,
    submap: u32,
    room: Option<u32>,
    /// Stamp, s.
    first_seen: f64,
    /// Stamp, s.
    last_seen: f64,
}

impl ThingJson {
    fn new(thing: &Thing) -> Self {
        let turn = &thing.bounds.world_from_box;
        Self {
            class: thing.class.name(),
            centre: thing.bounds.centre.into(),
            size: thing.bounds.size.into(),
            world_from_box: [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)])),
            confidence: thing.confidence,
            found: thing.found,
            submap: thing.submap.0,
            room: thing.room,
            first_seen: thing.first_seen,
            last_seen: thing.last_seen,
        }
    }
}

#[derive(Debug, Serialize)]
struct RoomJson {
    number: u32,
    submap: u32,
    /// m, world.
    centre: [f64; 3],
    /// m^2.
    area: f64,
}

#[derive(Debug, Serialize)]
struct LevelJson {
    rooms: Vec<RoomJson>,
    things: Vec<ThingJson>,
}

pub(crate) fn to_json(rooms: &[Room], things: &[Thing]) -> Result<String, Failure> {
    let room = |r: &Room| RoomJson {
        number: r.number,
        submap: r.submap.0,
        centre: r.centre.into(),
        area: r.area,
    };
    let level = LevelJson {
        rooms: rooms.iter().map(room).collect(),
        things: things.iter().map(ThingJson::new).collect(),
    };
    let text = serde_json::to_string_pretty(&level).map_err(Failure::input)?;
    Ok(format!("{text}\n"))
}

pub(crate) fn objects(args: &MapObjectsArgs) -> Result<Status, Failure> {
    let loaded = file::load(&args.file)?;
    let map = kept::things(&loaded, &args.file)?.ok_or_else(|| {
        Failure::input(format!(
            "{}: expected a map with things, found one in which no run has looked for them; run the recording with --things --save-map and a detector",
            args.file.display()
        ))
    })?;
    let view = loaded.file.map.view();
    let (rooms, things) = (map.rooms(view), map.list(view));
    if args.json {
        console::print(&to_json(&rooms, &things)?);
    } else {
        console::print(&text(&rooms, &things));
    }
    Ok(Status::Ok)
}

fn triple(v: &Vec3, digits: usize) -> String {
    let parts: Vec<String> = v.iter().map(|x| format!("{x:.digits$}")).collect();
    parts.join(" ")
}

fn text(rooms: &[Room], things: &[Thing]) -> String {
    let mut text = String::new();
    for r in rooms {
        text += &format!(
            "room {}: {:.1} m^2 around {} m, submap {}\n",
            r.number,
            r.area,
            triple(&r.centre, 2),
            r.submap.0
        );
    }
    text += &format!(
        "{:<14}{:>24}{:>20}  {:<11}{:<8}{:<6}last seen, s\n",
        "class", "centre, m", "size, m", "confidence", "submap", "room"
    );
    for t in things {
        text += &format!(
            "{:<14}{:>24}{:>20}  {:<11.2}{:<8}{:<6}{:.3}\n",
            t.class.name(),
            triple(&t.bounds.centre, 3),
            triple(&t.bounds.size, 2),
            t.confidence,
            t.submap.0,
            t.room.map_or("-".to_owned(), |r| r.to_string()),
            t.last_seen
        );
    }
    text
}
