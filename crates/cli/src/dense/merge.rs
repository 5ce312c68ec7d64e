//! `map merge`: merges the surfaces of two maps.

use crate::console;
use stillpoint::dense::DenseMap;
use stillpoint::map::Extension;
use stillpoint::slam::JoinedMaps;

/// The map file extension for the merged surfaces, in the first map's frame; `None` if neither map has one. Warns about parts that are left
/// out, and about parts whose keyframes moved.
pub(crate) fn joined(
    surfaces: [Option<DenseMap>; 2],
    maps: &JoinedMaps,
    names: &[String; 2],
) -> Option<Extension> {
    let _span = tracing::info_span!("fuse").entered();
    for (i, surface) in surfaces.iter().enumerate() {
        if let (Some(surface), Some(placed)) = (surface, maps.placed[i])
            && placed.bent > 0.5 * surface.voxel()
        {
            console::warn(&format!(
                "{}: merging moved its keyframes by up to {:.1} cm against each other, and its surface only as a whole: that may be off by as much; to have it follow, run its recording with --dense and the other map as --load-map",
                names[i],
                100.0 * placed.bent
            ));
        }
    }
    let map = match surfaces {
        [Some(first), Some(second)] => Some(both(first, &second, maps, &names[1])),
        [Some(first), None] => Some(first),
        [None, Some(second)] => alone(&second, maps, &names[1]),
        [None, None] => None,
    };
    map.map(|map| Extension {
        name: DenseMap::EXTENSION.to_owned(),
        bytes: map.to_bytes(),
    })
}

/// Merges both; keeps the first alone where they do not fit.
fn both(mut first: DenseMap, second: &DenseMap, maps: &JoinedMaps, name: &str) -> DenseMap {
    match maps.first_from_second() {
        None => left_out(name),
        Some(motion) => {
            if let Err(e) = first.absorb(second, &motion) {
                console::warn(&format!("{name}: its surface is left out: {e}"));
            }
        }
    }
    first
}

/// The second, where the first map has no surface.
fn alone(second: &DenseMap, maps: &JoinedMaps, name: &str) -> Option<DenseMap> {
    let Some(placed) = maps.placed[1] else {
        left_out(name);
        return None;
    };
    Some(second.moved(&placed.joined_from_map))
}

fn left_out(name: &str) {
    console::warn(&format!(
        "{name}: its surface is left out, since the submap that it is of was not recognised in the first submap of the other map"
    ));
}
