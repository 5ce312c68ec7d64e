//! What other systems reach on the same recordings: figures that were measured once, with their unit.

use stillpoint::evaluation::{Align, Table};

/// The median time that OpenCV's ORB (1000 features, one thread) took on the machine of [`PEERS`], ms.
const OPENCV_MS: f64 = 4.9;

/// How [`PEERS`] came about, for the report.
const SOURCE: &str = "Measured once by this project with the peers' own programs, built with -O3 -march=native, on a two-core x86-64 machine \
                      with AVX-512: one run each, frames paced in real time (late ones queue, none is skipped), images decoded beforehand. The \
                      vocabulary was trained for the purpose in place of ORBvoc.txt, and SG-SLAM had another small detector than its own. ATE is \
                      the RMSE after alignment by a rigid motion, of a fixed camera the RMS of its drift. Times are those of the tracking call: \
                      median / p95 / max. Their unit is OpenCV's ORB (1000 features, one thread, real 640x480 images), which took 4.9 ms there.";

/// A system on a recording.
struct Peer {
    recording: &'static str,
    system: &'static str,
    /// ATE or drift, with what has to be said of it.
    error_mm: &'static str,
    /// Median, 95th percentile, largest, ms.
    times_ms: [f64; 3],
}

const fn peer(
    recording: &'static str,
    system: &'static str,
    error_mm: &'static str,
    times_ms: [f64; 3],
) -> Peer {
    Peer {
        recording,
        system,
        error_mm,
        times_ms,
    }
}

const ORB2: &str = "ORB-SLAM2";
const ORB3: &str = "ORB-SLAM3";
const NGD: &str = "NGD-SLAM (YOLO on the CPU)";
const SG: &str = "SG-SLAM (NanoDet on the CPU)";

#[rustfmt::skip]
const PEERS: &[Peer] = &[
    peer("fr1_xyz", ORB2, "11.0", [15.5, 18.4, 28.0]),
    peer("fr1_xyz", ORB3, "12.0", [13.3, 16.5, 27.0]),
    peer("fr1_xyz", NGD, "11.6", [12.9, 30.1, 112.0]),
    peer("fr1_xyz", SG, "11.1", [30.2, 49.0, 64.0]),
    peer("fr1_xyz_walkers", ORB2, "219, 18 of 300 frames lost", [16.0, 20.2, 32.0]),
    peer("fr1_xyz_walkers", ORB3, "206", [12.8, 14.8, 29.0]),
    peer("fr1_xyz_walkers", NGD, "58 (other runs 31, 49, 110)", [24.0, 52.0, 128.0]),
    peer("fr1_xyz_walkers", SG, "11.1, 112 of 300 frames lost", [24.6, 47.4, 104.0]),
    peer("kitchen", ORB2, "47.1", [16.9, 24.1, 44.0]),
    peer("kitchen", ORB3, "48.0", [13.1, 15.8, 27.0]),
    peer("kitchen", NGD, "46.8", [12.9, 29.9, 119.0]),
    peer("kitchen", SG, "46.3", [27.9, 46.7, 64.0]),
    peer("corridor_fixed", ORB2, "2.9", [13.1, 14.8, 24.0]),
    peer("corridor_fixed", ORB3, "2.5", [11.3, 13.0, 25.0]),
    peer("corridor_fixed", NGD, "3.2", [15.0, 34.0, 95.0]),
    peer("corridor_fixed", SG, "2.1", [26.0, 34.5, 59.0]),
];

/// The table of the systems on those recordings that are asked for, with its source; empty when there is none.
pub(crate) fn markdown(recordings: &[&str]) -> String {
    let peers = PEERS.iter().filter(|p| recordings.contains(&p.recording));
    let mut table = Table::new([
        "recording",
        "system",
        "ATE or drift, mm",
        "tracking, ms",
        "OpenCV units",
    ])
    .align(1, Align::Left);
    let mut any = false;
    for p in peers {
        any = true;
        let [median, p95, max] = p.times_ms;
        table.row([
            p.recording.to_owned(),
            p.system.to_owned(),
            p.error_mm.to_owned(),
            format!("{median:.1} / {p95:.1} / {max:.0}"),
            format!("{:.1} / {:.1}", median / OPENCV_MS, p95 / OPENCV_MS),
        ]);
    }
    if any {
        format!("{SOURCE}\n\n{}", table.to_markdown())
    } else {
        String::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_are_shown_in_their_unit_on_the_recordings_that_are_there() {
        let text = markdown(&["fr1_xyz", "somewhere"]);
        assert!(text.contains("15.5 / 18.4 / 28 "), "{text}");
        assert!(text.contains(" 3.2 / 3.8 |"), "{text}");
        assert!(
            text.contains("4.9 ms") && !text.contains("kitchen"),
            "{text}"
        );
        assert_eq!(markdown(&["somewhere"]), "");
    }
}
