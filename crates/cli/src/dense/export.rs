//! `map mesh`, `map grid`, `map octomap`: export the dense part of a map file.

use crate::args::map::{MapGridArgs, MapMeshArgs, MapOctomapArgs};
use crate::console;
use crate::failure::{Failure, Status};
use crate::map::{file, kept};
use crate::output::StreamedFile;
use crate::run::paths;
use std::path::{Path, PathBuf};
use stillpoint::dense::{DenseMap, Floor, MeshOptions, PlanOptions};
use stillpoint::geometry::Vec3;
use stillpoint::slam::Up;

/// The dense map of a map file, and its up direction if stored.
fn load(path: &Path) -> Result<(DenseMap, Option<Up>), Failure> {
    let loaded = file::load(path)?;
    let map = kept::surface(&loaded, path)?.ok_or_else(|| {
        Failure::input(format!(
            "{}: expected a map with a surface, found one without; run the recording with --dense --save-map",
            path.display()
        ))
    })?;
    Ok((map, loaded.up()))
}

fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

/// The direction away from the floor: as given, else as stored in the map, else assuming that the camera was first held upright.
fn up(named: Option<[f64; 3]>, known: Option<Up>) -> Vec3 {
    let named = named.map(Vec3::from);
    named.or(known.map(|up| up.vector())).unwrap_or(-Vec3::y())
}

pub(crate) fn mesh(args: &MapMeshArgs) -> Result<Status, Failure> {
    let glb = match &*ending(&args.out) {
        "ply" => false,
        "glb" => true,
        _ => {
            return Err(Failure::input(format!(
                "{}: expected a name that ends with .ply or .glb, found another; name such a file with --out",
                args.out.display()
            )));
        }
    };
    paths::check(&[("--out", &args.out)], &[("the map", &args.file)])?;
    let (map, known_up) = load(&args.file)?;
    let mesh = map.mesh(&MeshOptions {
        min_area: args.min_area,
        ..MeshOptions::default()
    });
    let up = up(args.up, known_up);
    let up = Floor::find(&mesh, &up).map_or(up, |f| f.up);
    write(&args.out, |to| {
        if glb {
            mesh.write_glb(to, Some(&up))
        } else {
            mesh.write_ply(to)
        }
    })?;
    said(&args.out, &format!("{} triangles", mesh.triangles.len()))
}

pub(crate) fn grid(args: &MapGridArgs) -> Result<Status, Failure> {
    if ending(&args.out) != "yaml" {
        return Err(Failure::input(format!(
            "{}: expected a name that ends with .yaml, found another; name such a file with --out",
            args.out.display()
        )));
    }
    if args.low >= args.high {
        return Err(Failure::input(format!(
            "--low, --high: expected a band of heights, found {} to {} m; name the lower one first",
            args.low, args.high
        )));
    }
    let named = |suffix: &str| -> PathBuf {
        let stem = args.out.file_stem().unwrap_or_default().to_string_lossy();
        args.out.with_file_name(format!("{stem}{suffix}.pgm"))
    };
    let (image, crossed, distances) = (named(""), named("_crossed"), named("_distance"));
    let files = [&args.out, &image, &crossed, &distances];
    paths::check(&files.map(|f| ("--out", &**f)), &[("the map", &args.file)])?;
    let (map, known_up) = load(&args.file)?;
    let mesh = map.mesh(&MeshOptions::default());
    let floor = Floor::find(&mesh, &up(args.up, known_up)).ok_or_else(|| {
        Failure::criteria(format!(
            "{}: expected a floor, found no level surface; say with --up which way is up, or let the camera see the floor",
            args.file.display()
        ))
    })?;
    let options = PlanOptions {
        low: args.low,
        high: args.high,
    };
    let plan = map.plan(&floor, &options).ok_or_else(|| {
        Failure::criteria(format!(
            "{}: expected a plan of a room, found one of nothing, or of more than a kilometre",
            args.file.display()
        ))
    })?;
    write(&image, |to| plan.write_pgm(to))?;
    write(&crossed, |to| plan.write_crossed(to))?;
    write(&distances, |to| plan.write_distances(to))?;
    let name = image.file_name().unwrap_or_default().to_string_lossy();
    write(&args.out, |to| to.write_all(plan.yaml(&name).as_bytes()))?;
    said(
        &args.out,
        &format!(
            "{} x {} cells of {} m",
            plan.width, plan.height, plan.resolution
        ),
    )
}

pub(crate) fn octomap(args: &MapOctomapArgs) -> Result<Status, Failure> {
    paths::check(&[("--out", &args.out)], &[("the map", &args.file)])?;
    let (map, _) = load(&args.file)?;
    write(&args.out, |to| map.write_octomap(to))?;
    said(&args.out, &format!("cells of {} m", map.cell_side()))
}

fn write(
    path: &Path,
    content: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>,
) -> Result<(), Failure> {
    let mut file = StreamedFile::create(path, "--out")?;
    file.write(|to| content(to))?;
    file.finish()
}

fn said(path: &Path, what: &str) -> Result<Status, Failure> {
    console::report(&format!("{}: {what}\n", path.display()));
    Ok(Status::Ok)
}
