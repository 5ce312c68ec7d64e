//! `map`: what is in map files, and whether they are whole.

use crate::args_map::{MapCheckArgs, MapCommand, MapInfoArgs, MapMergeArgs};
use crate::failure::{Failure, Status};
use crate::map_file::{self, Loaded, MapOutput, Refusal};
use crate::models::megabytes;
use crate::{console, map_export};
use serde::Serialize;
use std::collections::BTreeMap;
use stillpoint::geometry::{Camera, Vec3};
use stillpoint::map::{KeyframeId, KeyframeSlot, MapView, PieceId};
use stillpoint::slam::{Config, join_maps};

/// `map`.
pub(crate) fn map(command: &MapCommand) -> Result<Status, Failure> {
    match command {
        MapCommand::Info(a) => info(a),
        MapCommand::Check(a) => check(a),
        MapCommand::Export(a) => map_export::export(a),
        MapCommand::Merge(a) => merge(a),
    }
}

fn info(args: &MapInfoArgs) -> Result<Status, Failure> {
    let info = MapInfo::new(
        &args.file.display().to_string(),
        &map_file::load(&args.file)?,
    );
    if args.json {
        let text = serde_json::to_string_pretty(&info).map_err(Failure::input)?;
        console::print(&format!("{text}\n"));
    } else {
        console::print(&info.text());
    }
    Ok(Status::Ok)
}

fn check(args: &MapCheckArgs) -> Result<Status, Failure> {
    match map_file::examine(&args.file) {
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

fn merge(args: &MapMergeArgs) -> Result<Status, Failure> {
    let first = map_file::load(&args.first)?.file.map;
    let second = map_file::load(&args.second)?.file.map;
    let scales = first.level_scales();
    let mut config = Config::default();
    config.features.levels = scales.len();
    config.features.scale_factor = scales.get(1).copied().unwrap_or(1.2);
    let file = MapOutput::create(&args.out)?;
    let [a, b] = [&first, &second].map(|m| m.view().pieces().len());
    let joined = join_maps(&config, first, &second)
        .map_err(|e| Failure::input(format!("{}: {e}", args.second.display())))?;
    let [before, left] = joined.pieces;
    if left == before {
        return Err(Failure::criteria(format!(
            "expected a place of {} in {}, found none among {} that look alike: nothing was written; a recording that begins where the first map is known and is run with --load-map ties them",
            args.second.display(),
            args.first.display(),
            joined.reports.len()
        )));
    }
    let saved = file.save(&joined.map)?;
    console::report(&format!(
        "{}: {} keyframes and {} landmarks; {} and {} pieces of map became {left}\n",
        saved.path, saved.keyframes, saved.landmarks, a, b
    ));
    Ok(Status::Ok)
}

/// What `map info` tells.
#[derive(Debug, Serialize)]
struct MapInfo {
    file: String,
    bytes: u64,
    /// Version of the file's format.
    format: u32,
    /// Version of the map: how often it was published.
    version: u64,
    keyframes: usize,
    /// Keyframes that were removed as redundant, and whose poses are kept.
    culled_keyframes: usize,
    landmarks: usize,
    observations: usize,
    /// Parts of which it is not known how they lie to each other.
    pieces: usize,
    /// Of the first and the last keyframe, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    stamps: Option<[f64; 2]>,
    /// Through all keyframes, culled ones too, piece by piece, m.
    path_length: f64,
    /// Of the box with the axes of the world around all landmarks, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    extent: Option<[f64; 3]>,
    cameras: Vec<CameraJson>,
    /// Of the pyramid that features come from.
    levels: usize,
    scale_factor: f32,
    extensions: Vec<ExtensionJson>,
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
            pieces: view.pieces().len(),
            stamps: stamps(view),
            path_length: path_length(view),
            extent: extent(view),
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
        line("pieces", self.pieces.to_string());
        if let Some([first, last]) = self.stamps {
            line(
                "time",
                format!("{first:.6} to {last:.6}: {:.1} s", last - first),
            );
        }
        line("path", format!("{:.2} m", self.path_length));
        if let Some([x, y, z]) = self.extent {
            line("extent", format!("{x:.2} x {y:.2} x {z:.2} m"));
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

/// All ids of keyframes that were ever given, and those between.
fn ids(view: &MapView) -> impl Iterator<Item = KeyframeId> {
    (0..view.keyframe_bound() as u32).map(KeyframeId)
}

/// The earliest and the latest stamp.
fn stamps(view: &MapView) -> Option<[f64; 2]> {
    let mut stamps = view.keyframes().map(|k| k.data.stamp);
    let first = stamps.next()?;
    Some(stamps.fold([first; 2], |[least, most], s| [least.min(s), most.max(s)]))
}

fn path_length(view: &MapView) -> f64 {
    // The last place in each piece.
    let mut last: BTreeMap<PieceId, Vec3> = BTreeMap::new();
    let mut length = 0.0;
    for id in ids(view) {
        let (Some(pose), Some(piece)) = (view.world_from_keyframe(id), view.piece_of(id)) else {
            continue;
        };
        if let Some(before) = last.insert(piece, pose.translation) {
            length += (pose.translation - before).norm();
        }
    }
    length
}

fn extent(view: &MapView) -> Option<[f64; 3]> {
    let mut positions = view
        .landmarks()
        .filter_map(|(id, _)| view.landmark_position(id));
    let first = positions.next()?;
    let (least, most) = positions.fold((first, first), |(least, most), p| {
        (least.inf(&p), most.sup(&p))
    });
    let size = most - least;
    Some([size.x, size.y, size.z])
}
