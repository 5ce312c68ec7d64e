//! Bytes of a map, by kind.

use stillpoint::map::{Keyframe, Landmark, Map};

/// Approximate overhead of an allocation: the counters of an `Arc`.
const COUNTERS: usize = 16;

pub(super) fn of_map(map: &Map) -> Vec<(&'static str, usize)> {
    let view = map.view();
    let sum =
        |bytes: &dyn Fn(&Keyframe) -> usize| view.keyframes().map(|k| bytes(k)).sum::<usize>();
    let observed = view.landmarks().map(|(id, _)| map.observations(id));
    vec![
        ("keypoints", sum(&|k| size_of_val(&*k.data.keypoints))),
        ("positions", sum(&|k| size_of_val(&*k.data.positions))),
        (
            "depths, sigmas, marks",
            sum(&|k| {
                let d = &k.data;
                size_of_val(&*d.sigma_px)
                    + size_of_val(&*d.depths)
                    + size_of_val(&*d.depth_sigmas)
                    + size_of_val(&*d.mappable)
            }),
        ),
        (
            "descriptors",
            sum(&|k| size_of_val(k.data.descriptors.as_slice())),
        ),
        ("buckets", sum(&|k| k.data.grid.bytes())),
        ("matches", sum(&|k| size_of_val(&*k.matches))),
        (
            "keyframes themselves",
            sum(&|k| size_of_val(k) + size_of_val(&*k.data) + size_of_val(&*k.covisible)),
        ),
        (
            "landmarks",
            view.landmark_count() * (size_of::<Landmark>() + COUNTERS) + view.table_bytes(),
        ),
        (
            "their observers",
            observed.map(|o| size_of_val(o) + 24).sum::<usize>(),
        ),
    ]
}
