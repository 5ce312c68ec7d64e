//! `map merge`: merges two maps that show the same places.

use crate::args::map::MapMergeArgs;
use crate::failure::{Failure, Status};
use crate::map::file::MapOutput;
use crate::{console, dense, map, things};
use stillpoint::slam::{Config, JoinedMaps, Timing, Up, join_maps};

pub(crate) fn merge(args: &MapMergeArgs) -> Result<Status, Failure> {
    let [first, second] = [&args.first, &args.second].map(|path| map::file::load(path));
    let (first, second) = (first?, second?);
    // Same camera: the readout with the smaller sigma is valid for both.
    let readouts = [first.readout(), second.readout()];
    let surest = readouts.into_iter().flatten();
    let surest = surest.min_by(|a, b| a[1].total_cmp(&b[1]));
    let timing = surest.map(|[readout, readout_sigma]| Timing {
        readout,
        readout_sigma,
        ..Timing::default()
    });
    let known = [
        map::kept::things(&first, &args.first)?,
        map::kept::things(&second, &args.second)?,
    ];
    let surfaces = [
        map::kept::surface(&first, &args.first)?,
        map::kept::surface(&second, &args.second)?,
    ];
    let ups = [first.up(), second.up()];
    let (first, second) = (first.file.map, second.file.map);
    map::file::check_alike([&args.first, &args.second], [&first, &second])?;
    map::file::check_room(&args.first, &first, second.view().keyframe_bound())?;
    let file = MapOutput::create(&args.out, "--out")?;
    let [a, b] = [&first, &second].map(|m| m.view().submaps().len());
    let joined = join_maps(&Config::default(), first, &second)
        .map_err(|e| Failure::input(format!("{}: {e}", args.second.display())))?;
    // Comparing the number of submaps is not enough: submaps of one map may have been joined.
    if joined.shared_submaps() == 0 {
        return Err(Failure::criteria(format!(
            "expected a place of {} in {}, found none among {} that look alike: nothing was written; a recording that begins where the first map is known and is run with --load-map ties them",
            args.second.display(),
            args.first.display(),
            joined.reports.len()
        )));
    }
    let things = things::joined(known, &joined);
    let names = [&args.first, &args.second].map(|path| path.display().to_string());
    let dense = dense::merge::joined(surfaces, &joined, &names);
    let [up, other] = ups;
    let up = up.or_else(|| turned(other?, &joined));
    let more = up
        .as_ref()
        .map(Up::to_extension)
        .into_iter()
        .chain(things)
        .chain(dense);
    let saved = file.save(&joined.map, timing.as_ref(), more.collect())?;
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

/// The second map's up direction in the first map's world; `None` if their relative pose is unknown.
fn turned(up: Up, joined: &JoinedMaps) -> Option<Up> {
    let placed = joined.placed[1]?;
    Up::along(&(placed.joined_from_map.rotation * up.vector()))
}
