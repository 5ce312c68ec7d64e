//! `map`: inspects, checks and processes map files.

pub(crate) mod export;
pub(crate) mod file;
mod graph;
pub(crate) mod kept;
pub(crate) mod merge;
pub(crate) mod readout;

use crate::args::map::{MapCheckArgs, MapCommand, MapInfoArgs};
use crate::console;
use crate::dense;
use crate::download::megabytes;
use crate::failure::{Failure, Status};
use crate::map::file::{Loaded, Refusal};
use crate::things;
use serde::Serialize;
use std::cmp::Reverse;
use stillpoint::geometry::{Camera, Vec3};
use stillpoint::map::{KeyframeId, KeyframeSlot, MapView, SubmapId};

pub(crate) fn map(command: &MapCommand) -> Result<Status, Failure> {
    match command {
        MapCommand::Info(a) => info(a),
        MapCommand::Check(a) => check(a),
        MapCommand::Export(a) => export::export(a),
        MapCommand::Mesh(a) => dense::export::mesh(a),
        MapCommand::Grid(a) => dense::export::grid(a),
        MapCommand::Octomap(a) => dense::export::octomap(a),
        MapCommand::Objects(a) => things::objects(a),
        MapCommand::Merge(a) => merge::merge(a),
    }
}

fn info(args: &MapInfoArgs) -> Result<Status, Failure> {
    let info = MapInfo::new(&args.file.display().to_string(), &file::load(&args.file)?);
    if args.json {
        let text = serde_json::to_string_pretty(&info).map_err(Failure::input)?;
        console::print(&format!("{text}\n"));
    } else {
        console::print(&info.text());
    }
    Ok(Status::Ok)
}

fn check(args: &MapCheckArgs) -> Result<Status, Failure> {
    match file::examine(&args.file) {
        Ok(loaded) => {
            let info = MapInfo::new(&args.file.display().to_string(), &loaded);
            console::report(&format!(
                "{}: ok: a map of {} keyframes and {} landmarks\n",
                info.file, info.keyframes, info.landmarks
            ));
            Ok(Status::Ok)
        }
        Err(Refusal::Content(message)) => Err(Failure::criteria(message)),
        Err(Refusal::System(failure)) => Err(failure),
    }
}

#[derive(Debug, Serialize)]
struct MapInfo {
    file: String,
    bytes: u64,
    /// Version of the file format.
    format: u32,
    /// Version of the map: how often it was published.
    version: u64,
    keyframes: usize,
    /// Keyframes that were culled as redundant; their poses are kept.
    culled_keyframes: usize,
    landmarks: usize,
    observations: usize,
    /// Number of closed loops, kept as measurements.
    loops: usize,
    /// Parts with unknown relative poses, the largest first.
    submaps: Vec<SubmapSummary>,
    /// Of the first and the last keyframe, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    stamps: Option<[f64; 2]>,
    /// Through all keyframes of the largest submap, culled ones included, m.
    path_length: f64,
    /// Of the axis-aligned box around all landmarks of the largest submap, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    extent: Option<[f64; 3]>,
    cameras: Vec<CameraJson>,
    /// Levels of the feature pyramid.
    levels: usize,
    scale_factor: f32,
    extensions: Vec<ExtensionJson>,
}

#[derive(Debug, Serialize)]
struct SubmapSummary {
    id: u32,
    keyframes: usize,
}

#[derive(Debug, PartialEq, Serialize)]
struct CameraJson {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// k1 k2 p1 p2 k3.
    distortion: [f64; 5],
}

#[derive(Debug, Serialize)]
struct ExtensionJson {
    name: String,
    bytes: usize,
}

impl MapInfo {
    fn new(path: &str, loaded: &Loaded) -> Self {
        let (file, map) = (&loaded.file, &loaded.file.map);
        let view = map.view();
        let scales = map.level_scales();
        let mut cameras: Vec<CameraJson> = Vec::new();
        for k in view.keyframes() {
            let camera = CameraJson::new(&k.data.camera);
            if !cameras.contains(&camera) {
                cameras.push(camera);
            }
        }
        let submaps = submaps(view);
        let largest = submaps.first().map(|p| p.0);
        let extension = |e: &stillpoint::map::Extension| ExtensionJson {
            name: e.name.clone(),
            bytes: e.bytes.len(),
        };
        Self {
            file: path.to_owned(),
            bytes: loaded.bytes,
            format: file.format,
            version: view.version(),
            keyframes: view.keyframe_count(),
            culled_keyframes: ids(view)
                .filter(|id| matches!(view.keyframe_slot(*id), KeyframeSlot::Culled { .. }))
                .count(),
            landmarks: view.landmark_count(),
            observations: view.landmarks().map(|(_, l)| l.observers as usize).sum(),
            loops: view.loops().count(),
            stamps: stamps(view),
            path_length: largest.map_or(0.0, |p| path_length(view, p)),
            extent: largest.and_then(|p| extent(view, p)),
            submaps: submaps
                .iter()
                .map(|(id, keyframes)| SubmapSummary {
                    id: id.0,
                    keyframes: *keyframes,
                })
                .collect(),
            cameras,
            levels: scales.len(),
            scale_factor: scales.get(1).copied().unwrap_or(1.0),
            extensions: file.extensions.iter().map(extension).collect(),
        }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| text += &format!("{name:<13}{value}\n");
        line(
            "file",
            format!(
                "{}, {}, format {}, version {} of the map",
                self.file,
                megabytes(self.bytes),
                self.format,
                self.version
            ),
        );
        line(
            "keyframes",
            format!("{}, and {} culled", self.keyframes, self.culled_keyframes),
        );
        line(
            "landmarks",
            format!("{}, observed {} times", self.landmarks, self.observations),
        );
        line("submaps", self.submaps_text());
        line("loops", self.loops.to_string());
        let of_submap = match &self.submaps[..] {
            [largest, _, ..] => format!(", of submap {}", largest.id),
            _ => String::new(),
        };
        if let Some([first, last]) = self.stamps {
            line(
                "time",
                format!("{first:.6} to {last:.6}: {:.1} s", last - first),
            );
        }
        line("path", format!("{:.2} m{of_submap}", self.path_length));
        if let Some([x, y, z]) = self.extent {
            line("extent", format!("{x:.2} x {y:.2} x {z:.2} m{of_submap}"));
        }
        for c in &self.cameras {
            let distorted = c.distortion.iter().any(|d| *d != 0.0);
            line(
                "camera",
                format!(
                    "{}x{} px, fx {:.1} fy {:.1} cx {:.1} cy {:.1}{}",
                    c.width,
                    c.height,
                    c.fx,
                    c.fy,
                    c.cx,
                    c.cy,
                    if distorted { ", distorted" } else { "" }
                ),
            );
        }
        line(
            "features",
            format!("{} levels, factor {}", self.levels, self.scale_factor),
        );
        for e in &self.extensions {
            line("extension", format!("{}, {} bytes", e.name, e.bytes));
        }
        text
    }

    /// The submaps as text, listed if there are several.
    fn submaps_text(&self) -> String {
        let submap = |p: &SubmapSummary| format!("{} ({} keyframes)", p.id, p.keyframes);
        let list: Vec<String> = self.submaps.iter().map(submap).collect();
        match list.len() {
            0 | 1 => list.len().to_string(),
            n => format!("{n}: {}", list.join(", ")),
        }
    }
}

impl CameraJson {
    fn new(c: &Camera) -> Self {
        let d = &c.distortion;
        Self {
            width: c.width,
            height: c.height,
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            distortion: [d.k1, d.k2, d.p1, d.p2, d.k3],
        }
    }
}

/// All keyframe ids in the range of those ever given.
fn ids(view: &MapView) -> impl Iterator<Item = KeyframeId> {
    (0..view.keyframe_bound() as u32).map(KeyframeId)
}

fn stamps(view: &MapView) -> Option<[f64; 2]> {
    let mut stamps = view.keyframes().map(|k| k.data.stamp);
    let first = stamps.next()?;
    Some(stamps.fold([first; 2], |[least, most], s| [least.min(s), most.max(s)]))
}

/// The submaps with their numbers of live keyframes, the largest first, of equals the oldest.
pub(crate) fn submaps(view: &MapView) -> Vec<(SubmapId, usize)> {
    let mut submaps = view.submaps();
    // The sort is stable, and they come by id.
    submaps.sort_by_key(|p| Reverse(p.1));
    submaps
}

fn path_length(view: &MapView, submap: SubmapId) -> f64 {
    let mut last: Option<Vec3> = None;
    let mut length = 0.0;
    for id in ids(view).filter(|id| view.submap_of(*id) == Some(submap)) {
        let Some(pose) = view.world_from_keyframe(id) else {
            continue;
        };
        if let Some(before) = last.replace(pose.translation) {
            length += (pose.translation - before).norm();
        }
    }
    length
}

fn extent(view: &MapView, submap: SubmapId) -> Option<[f64; 3]> {
    let mut positions = view
        .landmarks()
        .filter(|(_, l)| view.submap_of(l.anchor) == Some(submap))
        .filter_map(|(id, _)| view.landmark_position(id));
    let first = positions.next()?;
    let (least, most) = positions.fold((first, first), |(least, most), p| {
        (least.inf(&p), most.sup(&p))
    });
    let size = most - least;
    Some([size.x, size.y, size.z])
}
