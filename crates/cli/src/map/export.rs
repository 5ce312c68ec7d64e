//! `map export`: exports a map for other programs, one submap at a time, since their formats have a single frame of reference.

use crate::args::map::MapExportArgs;
use crate::failure::{Failure, Status};
use crate::map::file as map_file;
use crate::map::graph::Graph;
use crate::output::StreamedFile;
use crate::run::paths;
use crate::{console, map};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use stillpoint::datasets::point_cloud::{self, CloudFormat, CloudPoint};
use stillpoint::datasets::pose_graph;
use stillpoint::datasets::{StampedPose, trajectory};
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::map::{Keyframe, Landmark, LandmarkId, MapView, SubmapId};

pub(crate) fn export(args: &MapExportArgs) -> Result<Status, Failure> {
    let cloud = match &args.points {
        Some(path) => Some((path, cloud_format(path)?)),
        None => None,
    };
    let files = paths::named([
        ("--points", args.points.as_deref()),
        ("--trajectory", args.trajectory.as_deref()),
        ("--graph", args.graph.as_deref()),
    ]);
    paths::check(&files, &[("the map", &args.file)])?;
    let loaded = map_file::load(&args.file)?;
    let view = loaded.file.map.view();
    let part = Part {
        view,
        submap: choose_submap(args, view)?,
    };
    if let Some((path, format)) = cloud {
        let points = part.points();
        let names = ["observers", "depth_observers", "found", "keyframe"];
        let comment = "landmarks of a map of Stillpoint; metres";
        let bytes = point_cloud::format(format, &points, names, comment);
        write(path, "--points", &bytes)?;
        report(path, points.len(), "points");
    }
    if let Some(path) = &args.trajectory {
        let (poses, left_out) = part.poses();
        write(path, "--trajectory", trajectory::format(&poses).as_bytes())?;
        report(path, poses.len(), "poses");
        if left_out > 0 {
            console::warn(&format!(
                "{left_out} keyframes have the stamp of another and were left out of {}",
                path.display()
            ));
        }
    }
    if let Some(path) = &args.graph {
        let vertices: Vec<(u32, Se3)> = part
            .keyframes()
            .map(|k| (k.id.0, k.world_from_camera))
            .collect();
        let graph = Graph::measure(view, part.submap);
        let text = pose_graph::format(&vertices, &graph.edges);
        write(path, "--graph", text.as_bytes())?;
        let loops = graph.loops;
        report(path, graph.edges.len(), &format!("edges, {loops} of loops"));
        if graph.as_estimated > 0 {
            console::warn(&format!(
                "{} edges to parents are as estimated, since too little was measured between the two keyframes; their information is 1",
                graph.as_estimated
            ));
        }
    }
    Ok(Status::Ok)
}

fn cloud_format(path: &Path) -> Result<CloudFormat, Failure> {
    CloudFormat::of(path).ok_or_else(|| {
        Failure::input(format!(
            "--points {}: expected the name of a file that ends with .ply or .pcd, which says its format, found another; name it after the format that you want",
            path.display()
        ))
    })
}

/// Chooses the submap to write and reports the ones left out. `None` for a map without keyframes.
fn choose_submap(args: &MapExportArgs, view: &MapView) -> Result<Option<SubmapId>, Failure> {
    let submaps = map::submaps(view);
    let list = |submaps: &[(SubmapId, usize)]| {
        let submap = |(id, n): &(SubmapId, usize)| format!("{id} ({n} keyframes)");
        submaps.iter().map(submap).collect::<Vec<_>>().join(", ")
    };
    let chosen = match args.submap.map(SubmapId) {
        Some(id) if submaps.iter().all(|p| p.0 != id) => {
            return Err(Failure::input(format!(
                "{}: expected a submap after --submap, found {id}; its submaps are {}",
                args.file.display(),
                list(&submaps)
            )));
        }
        Some(id) => Some(id),
        None => submaps.first().map(|p| p.0),
    };
    let others: Vec<_> = submaps
        .into_iter()
        .filter(|p| Some(p.0) != chosen)
        .collect();
    if let Some(id) = chosen.filter(|_| !others.is_empty()) {
        let keyframes: usize = others.iter().map(|p| p.1).sum();
        console::warn(&format!(
            "{keyframes} keyframes are in other submaps than {id} and were left out: {}; how they lie to it is not known, and --submap writes another",
            list(&others)
        ));
    }
    Ok(chosen)
}

fn write(path: &Path, option: &'static str, bytes: &[u8]) -> Result<(), Failure> {
    let mut file = StreamedFile::create(path, option)?;
    file.write(|w| w.write_all(bytes))?;
    file.finish()
}

fn report(path: &Path, n: usize, what: &str) {
    console::report(&format!("{}: {n} {what}\n", path.display()));
}

struct Part<'a> {
    view: &'a MapView,
    submap: Option<SubmapId>,
}

impl<'a> Part<'a> {
    fn keyframes(&self) -> impl Iterator<Item = &'a Arc<Keyframe>> {
        let submap = self.submap;
        self.view
            .keyframes()
            .filter(move |k| Some(k.submap) == submap)
    }

    /// The landmarks, by id.
    fn points(&self) -> Vec<CloudPoint> {
        let view = self.view;
        let point = |(id, l): (LandmarkId, &Landmark)| {
            let anchor = view
                .keyframe(l.anchor)
                .filter(|k| Some(k.submap) == self.submap)?;
            let direction: Vec3 = anchor.world_from_camera.rotation * l.direction_in_anchor;
            let normal = direction.try_normalize(1e-9).map_or(Vec3::zeros(), |d| -d);
            Some(CloudPoint {
                position: view.landmark_position(id)?.into(),
                normal: normal.into(),
                counts: [l.observers, l.depth_observers, l.found, l.created_at.0],
            })
        };
        view.landmarks().filter_map(point).collect()
    }

    /// The keyframes by time, and the number of omitted duplicates: recordings in one map may share stamps, and a trajectory has one pose
    /// per stamp.
    fn poses(&self) -> (Vec<StampedPose>, usize) {
        let mut poses: Vec<StampedPose> = self
            .keyframes()
            .map(|k| StampedPose {
                stamp: k.data.stamp,
                world_from_camera: k.world_from_camera,
            })
            .collect();
        poses.sort_by(|a, b| a.stamp.total_cmp(&b.stamp));
        let before = poses.len();
        // To the precision of the file.
        poses.dedup_by_key(|p| (p.stamp * 1e6).round());
        let left_out = before - poses.len();
        (poses, left_out)
    }
}
