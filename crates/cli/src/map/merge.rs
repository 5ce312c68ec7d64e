//! `map merge`: two maps as one, where they show the same places.

use crate::args::map::MapMergeArgs;
use crate::failure::{Failure, Status};
use crate::map::file::MapOutput;
use crate::{console, map};
use stillpoint::slam::{Config, join_maps};

/// `map merge`.
pub(crate) fn merge(args: &MapMergeArgs) -> Result<Status, Failure> {
    let first = map::file::load(&args.first)?.file.map;
    let second = map::file::load(&args.second)?.file.map;
    map::file::check_alike([&args.first, &args.second], [&first, &second])?;
    map::file::check_room(&args.first, &first, second.view().keyframe_bound())?;
    let file = MapOutput::create(&args.out, "--out")?;
    let [a, b] = [&first, &second].map(|m| m.view().submaps().len());
    let joined = join_maps(&Config::default(), first, &second)
        .map_err(|e| Failure::input(format!("{}: {e}", args.second.display())))?;
    // Fewer submaps are not enough: those of one map may have been tied to each other.
    if joined.shared_submaps() == 0 {
        return Err(Failure::criteria(format!(
            "expected a place of {} in {}, found none among {} that look alike: nothing was written; a recording that begins where the first map is known and is run with --load-map ties them",
            args.second.display(),
            args.first.display(),
            joined.reports.len()
        )));
    }
    let saved = file.save(&joined.map)?;
    let submaps = map::submaps(joined.map.view());
    console::report(&format!(
        "{}: {} keyframes and {} landmarks; {a} and {b} submaps became {}\n",
        saved.path,
        saved.keyframes,
        saved.landmarks,
        submaps.len()
    ));
    Ok(Status::Ok)
}
