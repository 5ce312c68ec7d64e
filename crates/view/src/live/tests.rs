//! A simulated run with people, sent to readers that request at arbitrary times.

use super::*;
use crate::report::SurfaceColumns;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use stillpoint_geometry::{Camera, Se3};
use stillpoint_simulator::{Simulator, SimulatorConfig};
use stillpoint_slam::{Config, Simd, System};

const FRAMES: usize = 36;

/// The events of a run, and its final poses.
struct Walk {
    events: Vec<Event>,
    poses: BTreeMap<u32, Se3>,
    view: Arc<MapView>,
}

fn walk() -> &'static Walk {
    static WALK: OnceLock<Walk> = OnceLock::new();
    WALK.get_or_init(|| {
        let simulator = Simulator::new(&SimulatorConfig {
            scene: "walking_xyz".to_owned(),
            frames: Some(FRAMES),
            camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
            ..SimulatorConfig::default()
        })
        .unwrap();
        let camera = *simulator.camera();
        let mut system = System::new(Config::default(), camera, Simd::detect()).unwrap();
        let mut events = Vec::new();
        for i in 0..FRAMES {
            events.extend(system.step(simulator.frame(i)));
        }
        events.extend(system.finish());
        let view = system.view();
        let poses = system.trajectory().resolve(&view);
        Walk {
            poses: poses.map(|(e, pose)| (e.frame.0, pose)).collect(),
            events,
            view,
        }
    })
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Known {
    version: u64,
    name: String,
    /// By number: a frame's columns, as bits because missing values are NaN.
    frames: BTreeMap<u32, (u32, u8, u16, [u32; 7])>,
    landmarks: BTreeMap<u32, ([u32; 3], u32, u8)>,
    keyframes: BTreeMap<u32, [u32; 7]>,
    loops: Vec<u32>,
    marks: Vec<Mark>,
    picture: Option<u32>,
}

fn bits<const N: usize>(all: &[f32], i: usize) -> [u32; N] {
    std::array::from_fn(|k| all[N * i + k].to_bits())
}

impl Known {
    /// Applies the received text as the page does.
    fn take(&mut self, page: &LivePage) {
        let text = serde_json::to_string(&page.since(self.version)).unwrap();
        assert!(!text.contains('\n'), "an event is one line");
        let update: Update = serde_json::from_str(&text).unwrap();
        assert_eq!(update.about.is_some(), self.version == 0);
        self.version = update.version;
        if let Some(about) = update.about {
            self.name = about.name;
        }
        let f = &update.frames;
        if f.whole {
            self.frames.clear();
        }
        for id in &f.removed.0 {
            self.frames.remove(id);
        }
        let c = &f.columns;
        for (i, id) in c.id.0.iter().enumerate() {
            let row = (
                c.seconds.0[i].to_bits(),
                c.state.0[i],
                c.inliers.0[i],
                bits(&c.pose.0, i),
            );
            self.frames.insert(*id, row);
        }
        let (m, k) = (&update.map, &update.map.keyframes);
        if m.whole {
            self.landmarks.clear();
        }
        for id in &m.removed.0 {
            self.landmarks.remove(id);
        }
        for (i, id) in m.id.0.iter().enumerate() {
            let landmark = (bits(&m.position.0, i), m.frame.0[i], m.stands_still.0[i]);
            self.landmarks.insert(*id, landmark);
        }
        if k.whole {
            self.keyframes.clear();
        }
        for id in &k.removed.0 {
            self.keyframes.remove(id);
        }
        for (i, id) in k.id.0.iter().enumerate() {
            self.keyframes.insert(*id, bits(&k.pose.0, i));
        }
        if let Some(loops) = &m.loops {
            self.loops.clone_from(&loops.0);
        }
        self.marks.extend(update.marks);
        self.picture = update.picture.map(|p| p.frame).or(self.picture);
    }
}

fn page() -> LivePage {
    LivePage::new(About {
        name: "walk".to_owned(),
        ..About::default()
    })
}

/// Shows the events, updates the map where `follows` says so, and requests changes where `asks` does.
fn told(page: &mut LivePage, follows: &[bool], asks: &[Vec<bool>]) -> Vec<Known> {
    let mut readers = vec![Known::default(); asks.len()];
    for (i, event) in walk().events.iter().enumerate() {
        page.take(event, i.is_multiple_of(2));
        if follows[i % follows.len()] && page.is_behind() {
            page.follow_map(false);
        }
        for (reader, asks) in readers.iter_mut().zip(asks) {
            if asks[i % asks.len()] {
                reader.take(page);
            }
        }
    }
    page.follow_map(true);
    readers.iter_mut().for_each(|r| r.take(page));
    readers
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn readers_converge_at_any_polling_rate(
        follows in prop::collection::vec(any::<bool>(), 1..8),
        asks in prop::collection::vec(prop::collection::vec(any::<bool>(), 1..9), 3),
        most in prop_oneof![Just(12_usize), Just(18_000)],
    ) {
        let mut page = page();
        page.frames.set_most(most);
        page.scene.set_most(most * 20);
        let readers = told(&mut page, &follows, &asks);
        let mut fresh = Known::default();
        fresh.take(&page);
        for reader in readers {
            prop_assert_eq!(&reader, &fresh);
        }
        prop_assert!(fresh.frames.len() <= most && fresh.landmarks.len() <= most * 20);
    }
}

#[test]
fn final_update_contains_map_and_trajectory() {
    let mut page = page();
    let reader = told(&mut page, &[true], &[vec![true]]).remove(0);
    let view = &walk().view;
    assert_eq!(reader.landmarks.len(), view.landmark_count());
    for (id, _) in view.landmarks() {
        let position = view.landmark_position(id).unwrap();
        let told = reader.landmarks[&id.number()].0.map(f32::from_bits);
        assert_eq!(told, [position.x, position.y, position.z].map(|x| x as f32));
    }
    assert_eq!(reader.keyframes.len(), view.keyframe_count());
    assert_eq!(reader.frames.len(), FRAMES);
    let mut with_pose = 0;
    for (id, (_, _, _, pose)) in &reader.frames {
        let p = pose.map(f32::from_bits);
        if let Some(truth) = walk().poses.get(id) {
            // Here poses are anchored to one keyframe; the final trajectory interpolates between two.
            let t = truth.translation;
            let off = (0..3)
                .map(|k| (f64::from(p[k]) - t[k]).powi(2))
                .sum::<f64>();
            assert!(off.sqrt() < 0.02, "frame {id}: {p:?}, {t:?}");
            with_pose += 1;
        }
    }
    assert!(with_pose > FRAMES / 2);
    assert_eq!(page.since(0).now.frames, FRAMES as u64);
    assert!(reader.marks.iter().any(|m| m.kind == MarkKind::Begun));
    assert!(reader.picture.is_some());
}

#[test]
fn up_to_date_reader_gets_a_small_update() {
    let mut page = page();
    let reader = told(&mut page, &[true], &[vec![true]]).remove(0);
    let all = serde_json::to_string(&page.since(0)).unwrap().len();
    let news = serde_json::to_string(&page.since(reader.version))
        .unwrap()
        .len();
    assert!(news < 1500 && all > 20 * news, "{news} of {all} bytes");
}

#[test]
fn surface_is_sent_once_per_reader() {
    let mut page = page();
    let before = page.since(0).version;
    assert!(page.since(0).surface.is_none());
    let triangle = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    page.set_surface(SurfaceColumns::new(
        9,
        &triangle,
        &[[1, 2, 3]; 3],
        &[[0, 1, 2]],
    ));
    let told = page.since(before);
    assert_eq!(told.surface.map(|s| s.count), Some(9));
    assert!(page.since(told.version).surface.is_none());
    assert!(page.since(0).surface.is_some());
}

#[test]
fn latencies_are_assigned_to_their_frames() {
    let mut page = page();
    for event in &walk().events {
        if let Some(frame) = event.as_frame() {
            let id = frame.report.frame.0;
            page.measure(Measured {
                frame: Some(id - id % 2),
                latency_ms: Some(f64::from(id)),
                ..Measured::default()
            });
        }
        page.take(event, false);
    }
    let told = page.since(0).frames.columns;
    for (id, ms) in told.id.0.iter().zip(&told.time_ms.0) {
        assert_eq!(ms.is_finite(), id % 2 == 0, "{id}: {ms}");
    }
    assert!(page.since(0).picture.is_none(), "no picture was wanted");
}

#[test]
fn initial_map_is_shown_before_the_first_frame() {
    let mut page = page();
    page.begin_with(Arc::clone(&walk().view));
    page.follow_map(false);
    let update = page.since(0);
    assert_eq!(update.map.id.0.len(), walk().view.landmark_count());
    assert_eq!(update.now.frames, 0);
}

#[test]
fn page_requests_only_its_own_events() {
    let html = to_html("a <b>");
    assert!(html.contains("<title>a &lt;b> - Stillpoint</title>"));
    assert!(html.contains("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'"));
    assert_eq!(html.matches("EventSource(").count(), 1);
    for what in [
        "http://", "https://", "@import", "src=\"", "fetch(", "XMLHttp", "{{",
    ] {
        assert!(!html.contains(what), "{what}");
    }
}

#[test]
fn only_the_newest_map_version_is_held() {
    let mut page = LivePage::new(About::default());
    let mut given = Vec::new();
    for event in &walk().events {
        let Event::Mapped { report, view } = event else {
            page.receive(event);
            continue;
        };
        // Separate copies, so that references to them can be detected; more than are remembered.
        for _ in 0..10 {
            let view = Arc::new(MapView::clone(view));
            given.push(Arc::downgrade(&view));
            let report = report.clone();
            page.receive(&Event::Mapped { report, view });
            let held = given.iter().filter(|v| v.strong_count() > 0);
            assert_eq!(held.count(), 1);
        }
    }
    assert!(given.len() >= 20, "{} versions", given.len());
}
