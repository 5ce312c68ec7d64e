//! Keys of earlier versions, and their replacements.

/// Key and replacement.
const REMOVED: &[(&str, &str)] = &[
    (
        "features.levels",
        "it is fixed at 5, so that any two maps can be joined",
    ),
    (
        "features.scale_factor",
        "it is fixed at 1.45, so that any two maps can be joined",
    ),
    ("objects.coast_seconds", "it is fixed at 1.5 s"),
    ("objects.parked_seconds", "it is fixed at 2 s"),
    (
        "looping.max_cost",
        "looping.min_odds says how much must speak for a loop",
    ),
    (
        "features.fast_threshold_low",
        "it follows features.fast_threshold",
    ),
    (
        "features.subpixel",
        "corners are always refined to a fraction of a pixel",
    ),
    (
        "static_filter.objects",
        "static_filter.parts names what the filter uses, e.g. \"G+D\" without objects",
    ),
    (
        "static_filter.geometry",
        "static_filter.parts names what the filter uses, e.g. \"O+D\" without flow",
    ),
    (
        "static_filter.depth",
        "static_filter.parts names what the filter uses, e.g. \"O+G\" without depth",
    ),
    (
        "objects.tentative_misses",
        "it is fixed at a tenth of a second",
    ),
    (
        "keyframes.min_gap",
        "keyframes.min_seconds says it in seconds: three frames of 30 Hz are 0.09",
    ),
    ("objects.acceleration", "it is fixed at 1 m/s^2"),
    ("objects.side_sigma", "it is fixed at 0.1"),
    ("objects.parked_share", "it is fixed at 0.8"),
    ("tracking.min_initial_points", "it is fixed at 100"),
    (
        "tracking.min_relocalisation_inliers",
        "it follows tracking.min_inliers, of which it is 5/3",
    ),
    (
        "tracking.motion_radius",
        "it is fixed at 15 px, and three times as much where that finds too little",
    ),
    ("tracking.local_radius", "it is fixed at 2"),
    (
        "keyframes.min_tracked_share_first",
        "keyframes.min_tracked_share holds from the first keyframe on",
    ),
    (
        "keyframes.min_close_tracked",
        "keyframes.max_view_angle says what a new view is; at 0 every frame is a keyframe that keyframes.min_seconds allows",
    ),
    (
        "keyframes.min_close_untracked",
        "keyframes.max_view_angle says what a new view is",
    ),
    (
        "mapping.min_depth_landmarks",
        "it is fixed at 100; sensor.close_depth says which points are close",
    ),
    ("mapping.min_shared", "it is fixed at 15"),
    (
        "mapping.fixed_window",
        "it follows mapping.window, of which it is 3/2",
    ),
    ("mapping.min_found_share", "it is fixed at 0.25"),
    (
        "tracking.new_piece_after",
        "tracking.new_submap_seconds says it in seconds: 30 frames of 30 Hz are 1.0",
    ),
    (
        "tracking.new_submap_after",
        "tracking.new_submap_seconds says it in seconds: 30 frames of 30 Hz are 1.0",
    ),
    ("schedule.looper", "it is called schedule.loop_closer"),
    ("looping.min_gap", "it is fixed at 10"),
    (
        "looping.consistency",
        "looping.min_odds says how much must speak for a loop",
    ),
    (
        "looping.min_rigid_inliers",
        "looping.min_odds says how much must speak for a loop",
    ),
    (
        "looping.min_inliers",
        "looping.min_odds says how much must speak for a loop",
    ),
];

/// The replacement of a removed key.
pub(super) fn instead_of(path: &str) -> Option<&'static str> {
    let found = REMOVED.iter().find(|(key, _)| *key == path);
    found.map(|(_, instead)| *instead)
}
