//! Objects in the room, from exact boxes.

use crate::room::{Run, run};
use std::sync::{Arc, OnceLock};
use stillpoint_dense::{Thing, ThingMap, Things, ThingsConfig};
use stillpoint_detection::{BoundingBox, ClassId, Motion, Object, ObjectId, ObjectState};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_imaging::DepthImage;
use stillpoint_map::MapView;
use stillpoint_simulator::MoverBox;
use stillpoint_slam::{Event, FrameEvent, Segments, Subscriber};

const FRAMES: usize = 48;

fn object(seen: &MoverBox, class: &str, depths: [f64; 2]) -> Object {
    Object {
        id: ObjectId(seen.mover),
        class: ClassId::from_name(class).unwrap(),
        score: 0.8,
        state: ObjectState::Confirmed,
        bounds: BoundingBox {
            x0: seen.x0,
            y0: seen.y0,
            x1: seen.x1,
            y1: seen.y1,
        },
        bounds_sigma: [1.0; 2],
        depth_range: Some(depths),
        position: None,
        velocity: None,
        covariance: None,
        size: None,
        last_seen: 0.0,
        motion: Motion::Unknown,
    }
}

/// The events of a run in which all objects are tracked exactly; `edit` modifies a frame's event.
pub(crate) fn told(edit: &dyn Fn(usize, &mut FrameEvent)) -> Vec<Event> {
    let change = |event: &Event| match event {
        Event::Frame(frame) => {
            let i = frame.report.frame.0 as usize;
            let mut frame = FrameEvent::clone(frame);
            frame.report.segments = Segments::default();
            let seen = desk().simulator.truth(i).things;
            let known = desk().simulator.things();
            let pose = desk()
                .simulator
                .world_from_camera(desk().simulator.stamp(i));
            let objects = seen.iter().filter(|b| b.visible_px >= 60).map(|b| {
                let thing = known[b.mover as usize - 1].1;
                let z = pose.inverse().transform(&Vec3::from(thing.centre)).z;
                let reach = 0.5 * Vec3::from(thing.size).norm() + 0.02;
                object(b, b.class, [z - reach, z + reach])
            });
            frame.report.objects = objects.collect();
            edit(i, &mut frame);
            Event::Frame(Arc::new(frame))
        }
        other => other.clone(),
    };
    desk().events.iter().map(change).collect()
}

pub(crate) fn desk() -> &'static Run {
    static RUN: OnceLock<Run> = OnceLock::new();
    RUN.get_or_init(|| run("xyz", FRAMES))
}

pub(crate) fn view() -> Arc<MapView> {
    let mut views = desk().events.iter().filter_map(Event::view);
    Arc::clone(views.next_back().unwrap())
}

fn gathered(events: &[Event], known: Option<ThingMap>) -> ThingMap {
    let mut things = Things::new(&ThingsConfig::default(), desk().simulator.camera());
    if let Some(known) = known {
        things = things.starting_with(known);
    }
    things.receive_all(events);
    assert!(things.taken().len() > 6 && things.bytes() > 10_000);
    things.at(&view())
}

fn place(thing: &Thing) -> Vec3 {
    let first = desk().simulator.world_from_camera(0.0);
    let room_from_map: Se3 = first * desk().poses[0].world_from_camera.inverse();
    room_from_map.transform(&thing.bounds.centre)
}

pub(crate) fn listed<'a>(list: &'a [Thing], class: &str) -> Vec<&'a Thing> {
    let class = ClassId::from_name(class).unwrap();
    list.iter().filter(|t| t.class == class).collect()
}

#[test]
fn things_are_found_at_their_true_positions() {
    let list = gathered(&told(&|_, _| ()), None).list(&view());
    let truth = desk().simulator.things();
    for class in ["tv", "keyboard", "cup"] {
        let found = listed(&list, class);
        assert!(!found.is_empty(), "no {class} in {list:?}");
        for thing in found {
            let at = place(thing);
            let of_class = truth.iter().filter(|t| t.1.class == class);
            let errors = of_class.map(|t| (Vec3::from(t.1.centre) - at).norm());
            let error = errors.fold(f64::INFINITY, f64::min);
            assert!(error < 0.15, "{class} off by {error} m");
            assert!(thing.confidence > 0.4 && thing.found >= 4, "{thing:?}");
            assert!(thing.first_seen <= thing.last_seen);
        }
    }
}

#[test]
fn things_are_deterministic_and_round_trip() {
    let map = gathered(&told(&|_, _| ()), None);
    let bytes = map.to_bytes();
    assert!(bytes == gathered(&told(&|_, _| ()), None).to_bytes());
    let read = ThingMap::from_bytes(&bytes).unwrap();
    assert!(read == map);
    assert_eq!(read.list(&view()), map.list(&view()));
    // Without views nothing changes, and a second run over the same room adds nothing.
    let mut idle = Things::new(&ThingsConfig::default(), desk().simulator.camera())
        .starting_with(read.clone());
    idle.receive_all(&[]);
    assert!(idle.at(&view()).to_bytes() == bytes);
    // Objects with too few detections may be listed now, but none twice.
    let again = gathered(&told(&|_, _| ()), Some(read)).list(&view());
    let before = map.list(&view());
    for class in ["tv", "keyboard", "cup"] {
        let (old, new) = (listed(&before, class), listed(&again, class));
        assert_eq!(old.len(), new.len(), "{class}");
        for thing in old {
            let same = new.iter().find(|t| {
                (t.bounds.centre - thing.bounds.centre).norm() < 0.05 && t.found == 2 * thing.found
            });
            assert!(same.is_some(), "{thing:?} in {new:?}");
        }
    }
}

#[test]
fn people_and_moving_objects_are_no_things() {
    let screen = ClassId::from_name("tv").unwrap();
    let people = told(&|_, frame| {
        let mut objects = frame.report.objects.to_vec();
        for o in objects.iter_mut().filter(|o| o.class == screen) {
            o.class = ClassId::PERSON;
        }
        frame.report.objects = objects.into();
    });
    let list = gathered(&people, None).list(&view());
    assert!(listed(&list, "person").is_empty() && listed(&list, "tv").is_empty());
    assert!(!listed(&list, "keyboard").is_empty());
    let moving = told(&|_, frame| {
        let mut objects = frame.report.objects.to_vec();
        objects.iter_mut().for_each(|o| o.motion = Motion::Moving);
        frame.report.objects = objects.into();
    });
    assert!(gathered(&moving, None).list(&view()).is_empty());
}

/// The screens are removed at some frame: the camera sees a metre farther at their place.
#[test]
fn removed_things_disappear() {
    let screen = ClassId::from_name("tv").unwrap();
    let taken = |from: usize| {
        told(&move |i, frame| {
            if i < from {
                return;
            }
            let seen = frame.frame.as_ref().unwrap();
            let mut depth = seen.depth.data().to_vec();
            let width = seen.depth.width();
            let (screens, others): (Vec<Object>, Vec<Object>) = frame
                .report
                .objects
                .iter()
                .cloned()
                .partition(|o| o.class == screen);
            for b in screens.iter().map(|o| o.bounds) {
                for (k, z) in depth.iter_mut().enumerate() {
                    let (x, y) = ((k % width) as f64, (k / width) as f64);
                    if x >= b.x0 && x <= b.x1 && y >= b.y0 && y <= b.y1 {
                        *z += 1.0;
                    }
                }
            }
            let mut image = (**seen).clone();
            image.depth = DepthImage::from_vec(width, seen.depth.height(), depth).unwrap();
            frame.frame = Some(Arc::new(image));
            frame.report.objects = others.into();
        })
    };
    let kept = gathered(&taken(FRAMES), None).list(&view());
    assert!(!listed(&kept, "tv").is_empty());
    let gone = gathered(&taken(FRAMES / 2), None).list(&view());
    assert!(listed(&gone, "tv").is_empty(), "{gone:?}");
    assert!(!listed(&gone, "keyboard").is_empty());
    // Objects known from an earlier run are removed too.
    let known = gathered(&taken(FRAMES), None);
    let gone = gathered(&taken(0), Some(known)).list(&view());
    assert!(listed(&gone, "tv").is_empty(), "{gone:?}");
}

/// Only the left third of each keyboard has depth, as at an image border: the rest of their boxes does not locate them.
#[test]
fn things_with_partial_depth_are_found() {
    let keyboard = ClassId::from_name("keyboard").unwrap();
    let events = told(&|_, frame| {
        let seen = frame.frame.as_ref().unwrap();
        let mut depth = seen.depth.data().to_vec();
        let width = seen.depth.width();
        for b in frame.report.objects.iter().filter(|o| o.class == keyboard) {
            let b = b.bounds;
            for (k, z) in depth.iter_mut().enumerate() {
                let (x, y) = ((k % width) as f64, (k / width) as f64);
                let within = x <= b.x1 && y >= b.y0 && y <= b.y1;
                if within && x > b.x0 + 0.35 * b.width() {
                    *z = 0.0;
                }
            }
        }
        let mut image = (**seen).clone();
        image.depth = DepthImage::from_vec(width, seen.depth.height(), depth).unwrap();
        frame.frame = Some(Arc::new(image));
    });
    let list = gathered(&events, None).list(&view());
    assert!(!listed(&list, "keyboard").is_empty(), "{list:?}");
}

#[test]
fn undivided_space_is_one_room_with_all_things() {
    let map = gathered(&told(&|_, _| ()), None);
    let rooms = map.rooms(&view());
    assert_eq!(rooms.len(), 1, "{rooms:?}");
    assert!(rooms[0].number == 1 && (1.0..40.0).contains(&rooms[0].area));
    let list = map.list(&view());
    assert!(list.len() > 3 && list.iter().all(|t| t.room == Some(1)));
    // A round trip keeps the room, and so does a continued run.
    let read = ThingMap::from_bytes(&map.to_bytes()).unwrap();
    assert_eq!(read.rooms(&view()), rooms);
    let again = gathered(&told(&|_, _| ()), Some(read)).rooms(&view());
    assert!(
        again.len() == 1 && (again[0].area - rooms[0].area).abs() < 0.5,
        "{again:?}"
    );
}

/// Joining a map with itself keeps each object once.
#[test]
fn joined_maps_contain_each_thing_once() {
    let map = gathered(&told(&|_, _| ()), None);
    let joined = ThingMap::joined(&map, &map, 0, &view());
    let (before, after) = (map.list(&view()), joined.list(&view()));
    // Objects with too few detections may be listed now.
    for a in &before {
        let same = |b: &&Thing| b.class == a.class && b.found == 2 * a.found;
        let near = |b: &&Thing| (a.bounds.centre - b.bounds.centre).norm() < 0.03;
        let found = after.iter().filter(|b| same(b) && near(b)).count();
        assert_eq!(found, 1, "{a:?} in {after:?}");
    }
    assert_eq!(joined.rooms(&view()), map.rooms(&view()));
    // Objects of keyframes that the map lacks are not listed, but kept.
    let elsewhere = ThingMap::joined(&ThingMap::default(), &map, 100_000, &view());
    assert!(elsewhere.list(&view()).is_empty() && !elsewhere.is_empty());
}

/// The events of the run with a black chair added without rendering: in its box, whose centre on the floor is `at` in each frame, nothing
/// is measured.
fn with_black_chair(at: &dyn Fn(usize) -> [f64; 2]) -> Vec<Event> {
    let table = ClassId::from_name("dining table").unwrap();
    told(&|i, frame| {
        let simulator = &desk().simulator;
        let pose = simulator.world_from_camera(simulator.stamp(i)).inverse();
        let [x, y] = at(i);
        let far = f64::INFINITY;
        let (mut low, mut high) = ([far; 2], [-far; 2]);
        for k in 0..8_u32 {
            let side = |bit: u32| f64::from(k >> bit & 1) - 0.5;
            let corner = Vec3::new(x + 0.55 * side(0), y + 0.6 * side(1), 0.5 + side(2));
            let px = simulator.camera().project(&pose.transform(&corner));
            (0..2).for_each(|c| low[c] = low[c].min(px[c]));
            (0..2).for_each(|c| high[c] = high[c].max(px[c]));
        }
        let bounds = BoundingBox {
            x0: low[0].max(0.0),
            y0: low[1].max(0.0),
            x1: high[0].min(239.0),
            y1: high[1].min(179.0),
        };
        let mut objects: Vec<Object> = frame.report.objects.to_vec();
        objects.retain(|o| o.class == table);
        let seen = MoverBox {
            mover: 900,
            class: "chair",
            x0: bounds.x0,
            y0: bounds.y0,
            x1: bounds.x1,
            y1: bounds.y1,
            visible_px: 1000,
            from_behind: false,
            motion: None,
        };
        objects.push(object(&seen, "chair", [1.0, 4.0]));
        frame.report.objects = objects.into();
        let image = frame.frame.as_ref().unwrap();
        let (width, height) = (image.depth.width(), image.depth.height());
        let mut depth = image.depth.data().to_vec();
        for (k, z) in depth.iter_mut().enumerate() {
            let (x, y) = ((k % width) as f64, (k / width) as f64);
            let inside = x >= bounds.x0 - 14.0 && x <= bounds.x1 + 14.0;
            if inside && y >= bounds.y0 - 14.0 && y <= bounds.y1 + 14.0 {
                *z = 0.0;
            }
        }
        let mut image = (**image).clone();
        image.depth = DepthImage::from_vec(width, height, depth).unwrap();
        frame.frame = Some(Arc::new(image));
    })
}

#[test]
fn chair_without_depth_is_found_by_its_boxes() {
    // On the floor in the centre of the view.
    let pose = desk().simulator.world_from_camera(0.8);
    let ahead = (pose.rotation * Vec3::z()).xy().normalize();
    let chair = pose.translation.xy() + 2.2 * ahead;
    let chairs = |at: &dyn Fn(usize) -> [f64; 2]| {
        let list = gathered(&with_black_chair(at), None).list(&view());
        let chairs = listed(&list, "chair");
        chairs.into_iter().map(place).collect::<Vec<Vec3>>()
    };
    let found = chairs(&|_| chair.into());
    let off = found.first().map(|p| (p.xy() - chair).norm());
    assert!(
        found.len() == 1 && off.is_some_and(|off| off < 0.2),
        "{found:?} {off:?}"
    );
    // Control: boxes that alternate between two chairs give no location.
    let across = stillpoint_geometry::Vec2::new(-ahead.y, ahead.x);
    let two =
        |i: usize| (chair + if (i / 3).is_multiple_of(2) { 0.4 } else { -0.4 } * across).into();
    let found = chairs(&two);
    assert!(found.is_empty(), "{found:?}");
}
