//! The frames of a folder: associated images with their stamps.

use crate::associate::associate;
use crate::dataset::{Counts, Entry};
use crate::error::{DatasetError, Result};
use crate::layout::{Layout, association_file, has, has_lists, names_in, unknown};
use crate::lists::{
    Associations, ImageList, Said, parse_associations, parse_image_list, read_text,
};
use std::path::{Path, PathBuf};

/// Rate of data sets with frame numbers, Hz: 7-Scenes was recorded with a Kinect at this rate, and ICL-NUIM is rendered at it.
pub(crate) const NUMBERED_RATE: f64 = 30.0;

/// The frames of a folder in time order, and the numbers of unmatched images. Remarks go to `said`.
pub(crate) fn index(
    folder: &Path,
    names: &[String],
    layout: Layout,
    max_dt: f64,
    said: &mut Said,
) -> Result<(Vec<Entry>, Counts)> {
    match layout {
        Layout::Tum | Layout::Bonn => match (has_lists(names), association_file(names)) {
            (false, Some(file)) => index_associations(&folder.join(file), layout, max_dt, said),
            _ if has(names, "rgb.txt") => index_lists(folder, names, max_dt, said),
            _ => Err(unknown(folder, names)),
        },
        Layout::IclNuim => match association_file(names) {
            Some(file) => index_associations(&folder.join(file), layout, max_dt, said),
            None => index_numbered(folder),
        },
        Layout::Numbered => index_numbered(folder),
        Layout::SevenScenes => index_seven_scenes(folder, names),
    }
}

fn read_list(path: &Path) -> Result<ImageList> {
    let list = parse_image_list(&read_text(path)?, path)?;
    if list.stamps.is_empty() {
        return Err(DatasetError::NoFrames {
            path: path.to_owned(),
            expected: "lines of timestamp and file name".into(),
            found: "none".into(),
            advice: "download or export the data set again".into(),
        });
    }
    Ok(list)
}

fn index_lists(
    folder: &Path,
    names: &[String],
    max_dt: f64,
    said: &mut Said,
) -> Result<(Vec<Entry>, Counts)> {
    if !has(names, "depth.txt") {
        return Err(DatasetError::NoDepth {
            path: folder.to_owned(),
            expected: "depth.txt beside rgb.txt".into(),
            found: "rgb.txt only".into(),
        });
    }
    let colour_path = folder.join("rgb.txt");
    let mut colour = read_list(&colour_path)?;
    let depth_path = folder.join("depth.txt");
    let mut depth = parse_image_list(&read_text(&depth_path)?, &depth_path)?;
    if depth.stamps.is_empty() {
        return Err(DatasetError::NoDepth {
            path: depth_path,
            expected: "lines of timestamp and file name".into(),
            found: "none".into(),
        });
    }
    colour.bring_to_seconds(&colour_path, said);
    depth.bring_to_seconds(&depth_path, said);
    let set_back = colour.in_order(&colour_path, &[], said).set_back;
    let of_depth = depth.in_order(&depth_path, &set_back, said).set_back;
    said.set_back = if set_back.is_empty() {
        of_depth
    } else {
        set_back
    };
    let pairs = associate(&colour.stamps, &depth.stamps, max_dt);
    if pairs.is_empty() {
        let range = |l: &ImageList| {
            format!(
                "{:.3} to {:.3} s",
                l.stamps[0],
                l.stamps[l.stamps.len() - 1]
            )
        };
        return Err(DatasetError::NoFrames {
            path: folder.to_owned(),
            expected: format!("colour and depth stamps within {max_dt} s of each other"),
            found: format!(
                "colour from {}, depth from {}",
                range(&colour),
                range(&depth)
            ),
            advice: "check that both lists use the same clock".into(),
        });
    }
    let entries = pairs
        .iter()
        .map(|&(i, j)| Entry {
            stamp: colour.stamps[i],
            colour: folder.join(&colour.files[i]),
            depth_stamp: depth.stamps[j],
            depth: folder.join(&depth.files[j]),
        })
        .collect();
    Ok((
        entries,
        Counts::new(colour.stamps.len(), depth.stamps.len(), pairs.len()),
    ))
}

/// Pairs from an association file; ICL-NUIM has frame numbers instead of seconds.
fn index_associations(
    path: &Path,
    layout: Layout,
    max_dt: f64,
    said: &mut Said,
) -> Result<(Vec<Entry>, Counts)> {
    let list = parse_associations(&read_text(path)?, path)?;
    let numbered = layout == Layout::IclNuim && list.is_numbered();
    let rate = if numbered { NUMBERED_RATE } else { 1.0 };
    let Associations {
        mut colour,
        mut depth,
        ..
    } = list;
    if !numbered {
        colour.bring_to_seconds(path, said);
        depth.bring_to_seconds(path, &mut Said::default());
    }
    let total = colour.stamps.len();
    let folder = path.parent().unwrap_or(Path::new("."));
    let written = colour.stamps.clone();
    let mended = colour.in_order(path, &[], said);
    said.set_back.extend(&mended.set_back);
    // Depth follows the colour image in the same line.
    let lines = mended.stamps.iter().zip(&colour.files);
    let entries: Vec<Entry> = lines
        .filter(|((_, i), _)| (written[*i] - depth.stamps[*i]).abs() / rate < max_dt)
        .map(|((stamp, i), file)| Entry {
            stamp: stamp / rate,
            colour: folder.join(file),
            depth_stamp: (depth.stamps[*i] + (stamp - written[*i])) / rate,
            depth: folder.join(&depth.files[*i]),
        })
        .collect();
    if entries.is_empty() {
        return Err(DatasetError::NoFrames {
            path: path.to_owned(),
            expected: format!("pairs whose stamps are within {max_dt} s"),
            found: format!("none among {total} lines"),
            advice: "check the associations file".into(),
        });
    }
    let n = entries.len();
    Ok((entries, Counts::new(total, total, n)))
}

/// Files named by number, such as `0.png`, in numeric order.
pub(crate) fn numbered(folder: &Path) -> Result<Vec<(u32, PathBuf)>> {
    let mut files: Vec<(u32, PathBuf)> = names_in(folder)?
        .iter()
        .filter_map(|n| {
            let number = Path::new(n).file_stem()?.to_str()?.parse().ok()?;
            Some((number, folder.join(n)))
        })
        .collect();
    files.sort();
    files.dedup_by_key(|f| f.0);
    Ok(files)
}

/// Pairs by number, at the rate of data sets with frame numbers.
fn pair_numbered(
    folder: &Path,
    colour: Vec<(u32, PathBuf)>,
    depth: Vec<(u32, PathBuf)>,
) -> Result<(Vec<Entry>, Counts)> {
    let (n_colour, n_depth) = (colour.len(), depth.len());
    let entries: Vec<Entry> = colour
        .into_iter()
        .filter_map(|(number, file)| {
            let j = depth.binary_search_by_key(&number, |d| d.0).ok()?;
            let stamp = f64::from(number) / NUMBERED_RATE;
            Some(Entry {
                stamp,
                colour: file,
                depth_stamp: stamp,
                depth: depth[j].1.clone(),
            })
        })
        .collect();
    if n_depth == 0 {
        return Err(DatasetError::NoDepth {
            path: folder.to_owned(),
            expected: "a depth image for each of the colour images".into(),
            found: format!("{n_colour} colour images and no depth image"),
        });
    }
    if entries.is_empty() {
        return Err(DatasetError::NoFrames {
            path: folder.to_owned(),
            expected: "colour and depth images of the same numbers".into(),
            found: format!("{n_colour} colour and {n_depth} depth images, none in common"),
            advice: "check the file names".into(),
        });
    }
    let n = entries.len();
    Ok((entries, Counts::new(n_colour, n_depth, n)))
}

fn index_numbered(folder: &Path) -> Result<(Vec<Entry>, Counts)> {
    let depth = folder.join("depth");
    if !depth.is_dir() {
        return Err(DatasetError::NoDepth {
            path: folder.to_owned(),
            expected: "a folder depth beside rgb".into(),
            found: "none".into(),
        });
    }
    pair_numbered(folder, numbered(&folder.join("rgb"))?, numbered(&depth)?)
}

fn index_seven_scenes(folder: &Path, names: &[String]) -> Result<(Vec<Entry>, Counts)> {
    // The sorted names are zero-padded, but a number of seven digits must not come before one of six.
    let collect = |ending: &str| {
        let mut files: Vec<(u32, PathBuf)> = names
            .iter()
            .filter_map(|n| {
                let number = seven_scenes_number(n, ending)?;
                Some((number, folder.join(n)))
            })
            .collect();
        files.sort();
        files
    };
    pair_numbered(folder, collect(".color.png"), collect(".depth.png"))
}

/// The number in `frame-000012.color.png`.
pub(crate) fn seven_scenes_number(name: &str, ending: &str) -> Option<u32> {
    name.strip_prefix("frame-")?
        .strip_suffix(ending)?
        .parse()
        .ok()
}
