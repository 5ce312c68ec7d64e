//! Scores an estimate: `eval_json GROUNDTRUTH ESTIMATE [--delta 30f|1s] [--scale]`, printed as JSON. Takes and ignores
//! the word `eval` in front and `--json`, so that it can stand in for the command line in comparisons.
#![allow(clippy::print_stdout)]

use std::error::Error;
use stillpoint_evaluation::{EvalOptions, Score, Statistics, TimedPose, score};
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Se3, Vec3};

fn read(path: &str) -> Result<Vec<TimedPose>, Box<dyn Error>> {
    let mut poses = Vec::new();
    for line in std::fs::read_to_string(path)?.lines() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let v = line
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<Vec<f64>, _>>()?;
        let [stamp, x, y, z, qx, qy, qz, qw] = v[..] else {
            return Err(format!("{path}: expected 8 columns, found {line:?}").into());
        };
        let q = UnitQuaternion::new_normalize(Quaternion::new(qw, qx, qy, qz));
        poses.push(TimedPose {
            stamp,
            world_from_camera: Se3::new(q, Vec3::new(x, y, z)),
        });
    }
    Ok(poses)
}

fn json(s: &Statistics) -> String {
    format!(
        r#"{{"rmse":{:?},"sd":{:?},"mean":{:?},"median":{:?},"max":{:?}}}"#,
        s.rmse, s.sd, s.mean, s.median, s.max
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut options = EvalOptions::default();
    let mut files = Vec::new();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "eval" | "--json" => {}
            "--scale" => options.with_scale = true,
            "--delta" => options.delta = args.next().unwrap_or_default().parse()?,
            _ => files.push(arg),
        }
    }
    let [reference, estimate] = &files[..] else {
        return Err("expected GROUNDTRUTH ESTIMATE [--delta 30f|1s] [--scale]".into());
    };
    match score(&read(reference)?, &read(estimate)?, &options)? {
        Score::Moving(e) => {
            let rpe = e.rpe.map_or("null".into(), |r| {
                format!(
                    r#"{{"delta":"{}","pairs":{},"translation":{},"rotation_deg":{}}}"#,
                    r.delta,
                    r.pairs,
                    json(&r.translation),
                    json(&r.rotation_deg)
                )
            });
            println!(
                r#"{{"pairs":{},"ate":{},"scale":{:?},"rpe":{rpe}}}"#,
                e.pairs,
                json(&e.ate.statistics),
                e.ate.alignment.scale
            );
        }
        Score::Fixed(d) => println!(
            r#"{{"drift":{},"spread":{}}}"#,
            json(&d.drift),
            json(&d.spread)
        ),
    }
    Ok(())
}
