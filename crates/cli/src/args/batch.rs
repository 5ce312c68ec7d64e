//! Arguments of `batch`.

use crate::args::run::budget_ms;
use crate::args::{ConfigArgs, InputArgs, positive};
use crate::sinks::dense::voxel;
use crate::sinks::up::direction;
use clap::{Args, Subcommand};
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

/// Run many recordings, several at a time, and resume where an earlier batch ended.
///
/// An INPUT is a data set folder, a recording, a quoted pattern such as 'data/*.mcap', or @FILE: a list with one of these per line. Each
/// gets a result folder in --out, named after the input without its file extension. It holds the output of run, stderr.log (the messages of
/// the run) and recording.json (its row of the table).
///
/// Every run is a separate process. One that crashes, fails to open its input or exceeds --time-limit is reported, retried once after the
/// others, and does not affect them. The number of parallel runs follows from cores and free memory and is printed before the first run;
/// each run gets its share of the cores through STILLPOINT_WORKERS.
///
/// A finished recording is skipped when the batch is run again with the same input, configuration and program. The input is identified by
/// its path and, for each file, name, size and modification time, plus the first and last MiB of files that are not images. Results of
/// another program or configuration are replaced only with --replace. Ctrl-C ends the current runs and keeps all finished ones.
///
/// At the end the table is printed and written as batch.json, batch.parquet and batch.html, which links the reports and lists the worst
/// runs first.
#[derive(Clone, Debug, Args)]
#[command(
    verbatim_doc_comment,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    disable_help_subcommand = true,
    after_help = "Examples:
  stillpoint batch recordings/*.mcap --out results
  stillpoint batch @list.txt --out results --workers 8 --time-limit 3600
  stillpoint batch 'recordings/*' --out results/7 --shard 7/20
  stillpoint batch data/* --detector scripted:{}/detections.csv --dense --save-map map.spmap
  stillpoint batch merge results/* --out all

Exit code 0 when every recording has a result, be it with frames lost; 1 when one has none after two tries, or Ctrl-C ended the batch;
2 when the arguments, the inputs as a whole, or the output folder cannot be used, or its disk is full."
)]
pub(crate) struct BatchArgs {
    #[command(subcommand)]
    pub(crate) command: Option<BatchCommand>,
    /// Recordings, data set folders, patterns, and lists as @FILE.
    #[arg(value_name = "INPUT", required_unless_present = "list")]
    pub(crate) inputs: Vec<PathBuf>,
    /// File with one input per line; empty lines and lines that begin with # are ignored. May be repeated.
    #[arg(long, value_name = "FILE")]
    pub(crate) list: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, value_name = "DIR", default_value = "out/batch")]
    pub(crate) out: PathBuf,
    /// Name result folders by this many trailing parts of the path, joined by _.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(crate) name_parts: u8,
    /// Number of parallel runs [default: as many as cores and free memory allow].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub(crate) workers: Option<u16>,
    /// Run share I of N of the inputs, counted from 1, for job arrays. Each share needs its own --out; batch merge joins them.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub(crate) shard: Option<Shard>,
    /// End a run that takes longer than this.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    pub(crate) time_limit: Option<f64>,
    /// Replace results of another program or configuration.
    #[arg(long)]
    pub(crate) replace: bool,
    /// Print batch.json and nothing else on stdout.
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) each: EachArgs,
    #[command(flatten)]
    pub(crate) input: InputArgs,
    #[command(flatten)]
    pub(crate) config: ConfigArgs,
}

#[derive(Clone, Debug, Subcommand)]
pub(crate) enum BatchCommand {
    Merge(BatchMergeArgs),
}

/// Join the tables of several batches, such as the shards of one.
///
/// Writes the table, batch.json, batch.parquet and batch.html; the results stay in place and are linked. All batches must have the same
/// program and configuration, and no recording may occur in two of them. Shards that are missing or ended early are named.
#[derive(Clone, Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "Examples:
  stillpoint batch merge results/* --out all

Exit code 1 when a shard is missing or incomplete, or a recording has no result; 2 when the folders do not belong together."
)]
pub(crate) struct BatchMergeArgs {
    /// Folders of batches.
    #[arg(value_name = "DIR", required = true)]
    pub(crate) folders: Vec<PathBuf>,
    /// Folder to write to.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Print batch.json and nothing else on stdout.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Options of every run, as for run; output paths are relative to the result folder.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct EachArgs {
    /// Fuse the static scene into a surface: see run --help.
    #[arg(long)]
    pub(crate) dense: bool,
    /// Voxel size of the surface, m [default: 0.02].
    #[arg(long, value_name = "M", requires = "dense", value_parser = voxel)]
    pub(crate) voxel: Option<f64>,
    /// Approximate direction away from the floor, in the map frame [default: as for run].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
    /// Map the objects in the room: see run --help. Needs a detector.
    #[arg(long)]
    pub(crate) things: bool,
    /// Time budget per frame, ms: see run --help.
    #[arg(long, value_name = "N", value_parser = budget_ms)]
    pub(crate) budget_ms: Option<f64>,
    /// Do not write report.html into the result folders.
    #[arg(long)]
    pub(crate) no_report: bool,
    /// Save each map to this file in its result folder.
    #[arg(long, value_name = "FILE", value_parser = inside)]
    pub(crate) save_map: Option<PathBuf>,
    /// Record the results to this file in the result folder, as ROS 2 messages.
    #[arg(long, value_name = "FILE.mcap", value_parser = inside)]
    pub(crate) record: Option<PathBuf>,
    /// Write the objects of every frame to this file in the result folder.
    #[arg(long, value_name = "FILE.csv", value_parser = inside)]
    pub(crate) objects: Option<PathBuf>,
    /// Write the static filter's verdict on every keypoint to this file in the result folder.
    #[arg(long, value_name = "FILE.csv", value_parser = inside)]
    pub(crate) verdicts: Option<PathBuf>,
    /// Write a motion mask of every frame to this folder in the result folder.
    #[arg(long, value_name = "DIR", value_parser = inside)]
    pub(crate) masks: Option<PathBuf>,
}

impl EachArgs {
    /// These options as command line arguments of a run with result folder `out`.
    pub(crate) fn typed(&self, out: &Path) -> Vec<OsString> {
        let Self {
            dense,
            voxel,
            up,
            things,
            budget_ms,
            no_report,
            save_map,
            record,
            objects,
            verdicts,
            masks,
        } = self;
        let mut all: Vec<OsString> = Vec::new();
        for (option, is_set) in [
            ("--dense", dense),
            ("--things", things),
            ("--no-report", no_report),
        ] {
            all.extend(is_set.then(|| option.into()));
        }
        for (option, number) in [("--voxel", voxel), ("--budget-ms", budget_ms)] {
            all.extend(number.map(|n| format!("{option}={n}").into()));
        }
        all.extend(up.map(|[x, y, z]| format!("--up={x},{y},{z}").into()));
        for (option, file) in [
            ("--save-map", save_map),
            ("--record", record),
            ("--objects", objects),
            ("--verdicts", verdicts),
            ("--masks", masks),
        ] {
            if let Some(file) = file {
                all.extend([option.into(), out.join(file).into()]);
            }
        }
        all
    }
}

/// One share of the inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    /// Index, from 1.
    pub(crate) index: u32,
    /// Number of shares.
    pub(crate) of: u32,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text
        .split_once('/')
        .and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match numbers {
        Some((index, of)) if (1..=of).contains(&index) => Ok(Shard { index, of }),
        Some((index, of)) if of > 0 => Err(format!(
            "expected a share from 1 to {of}, found {index}; arrays of jobs may count from 0"
        )),
        _ => Err("expected I/N, the I-th of N shares, e.g. 3/8".to_owned()),
    }
}

/// Accepts only paths that stay inside the result folder.
fn inside(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let stays = path.components().all(|c| matches!(c, Component::Normal(_)));
    if stays && !text.is_empty() {
        Ok(path)
    } else {
        Err("expected a name within the result folder, since every recording has its own".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_numbered_from_one() {
        assert_eq!(shard("3/8"), Ok(Shard { index: 3, of: 8 }));
        for (text, part) in [
            ("9/8", "from 1 to 8, found 9"),
            ("0/8", "found 0; arrays of jobs may count from 0"),
            ("1/0", "I/N"),
            ("3", "I/N"),
            ("a/b", "I/N"),
        ] {
            let e = shard(text).unwrap_err();
            assert!(e.contains(part), "{text}: {e}");
        }
    }

    #[test]
    fn output_paths_must_stay_inside_the_run_folder() {
        for bad in ["/tmp/map", "../map", "a/../../map", "", "."] {
            assert!(inside(bad).is_err(), "{bad}");
        }
        let each = EachArgs {
            dense: true,
            voxel: Some(0.05),
            up: Some([0.0, -1.0, 0.5]),
            things: true,
            budget_ms: Some(20.0),
            no_report: true,
            save_map: Some("m.spmap".into()),
            record: Some("r.mcap".into()),
            objects: Some("o.csv".into()),
            verdicts: Some("v.csv".into()),
            masks: Some("masks/png".into()),
        };
        let found: Vec<String> = each
            .typed(Path::new("out/a"))
            .iter()
            .map(|a| a.to_string_lossy().into_owned())
            .collect();
        assert_eq!(
            found.join(" "),
            "--dense --things --no-report --voxel=0.05 --budget-ms=20 --up=0,-1,0.5 --save-map out/a/m.spmap --record out/a/r.mcap \
             --objects out/a/o.csv --verdicts out/a/v.csv --masks out/a/masks/png"
        );
    }
}
