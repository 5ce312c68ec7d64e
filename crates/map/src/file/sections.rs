//! Sections of a map file.

/// A part of a map, stored in the order of [`Part::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// Version of the map, level scales, and counts of all elements.
    Header,
    /// The distinct cameras.
    Cameras,
    /// Ids, poses, stamps and lengths of the live keyframes.
    Keyframes,
    /// Poses of culled keyframes.
    Tombstones,
    /// Pairs of keyframes that share landmarks.
    Covisibility,
    /// Keypoints of all keyframes, concatenated.
    Keypoints,
    /// Undistorted positions with standard deviations.
    Positions,
    Depths,
    Descriptors,
    /// Landmark observed by each feature, and whether it may observe one.
    Matches,
    /// State of each landmark id: live, merged, culled.
    LandmarkSlots,
    /// The live landmarks.
    Landmarks,
    /// Their positions and viewing directions.
    LandmarkPositions,
    /// Their descriptors.
    LandmarkDescriptors,
}

impl Part {
    pub(super) const ALL: [Self; 14] = [
        Self::Header,
        Self::Cameras,
        Self::Keyframes,
        Self::Tombstones,
        Self::Covisibility,
        Self::Keypoints,
        Self::Positions,
        Self::Depths,
        Self::Descriptors,
        Self::Matches,
        Self::LandmarkSlots,
        Self::Landmarks,
        Self::LandmarkPositions,
        Self::LandmarkDescriptors,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Header => "header",
            Self::Cameras => "cameras",
            Self::Keyframes => "keyframes",
            Self::Tombstones => "tombstones",
            Self::Covisibility => "covisibility",
            Self::Keypoints => "keypoints",
            Self::Positions => "positions",
            Self::Depths => "depths",
            Self::Descriptors => "descriptors",
            Self::Matches => "matches",
            Self::LandmarkSlots => "landmark slots",
            Self::Landmarks => "landmarks",
            Self::LandmarkPositions => "landmark positions",
            Self::LandmarkDescriptors => "landmark descriptors",
        }
    }

    /// Whether the part may be compressed. Descriptors are noise. Elements of the other uncompressed parts take many
    /// times their size in memory, so that compression would allow a small file to demand too much.
    pub(super) fn may_compress(self) -> bool {
        match self {
            Self::Header | Self::Cameras | Self::Keyframes | Self::Tombstones => false,
            Self::Descriptors | Self::LandmarkSlots | Self::LandmarkDescriptors => false,
            Self::Covisibility | Self::Keypoints | Self::Positions | Self::Depths => true,
            Self::Matches | Self::Landmarks | Self::LandmarkPositions => true,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) cameras: u32,
    /// One more than the largest keyframe id.
    pub(super) keyframe_slots: u32,
    pub(super) keyframes: u32,
    pub(super) tombstones: u32,
    pub(super) covisible_pairs: u32,
    pub(super) landmark_slots: u32,
    pub(super) landmarks: u32,
    /// Of all live keyframes.
    pub(super) features: u64,
}

/// No keyframe or landmark; as a landmark slot: live.
pub(super) const NONE: u32 = u32::MAX;
/// As a landmark slot: culled. Smaller values are the landmark it was merged into.
pub(super) const CULLED: u32 = u32::MAX - 1;
/// Maximum number of keyframe slots. Empty slots cost almost no memory, but time in every traversal: this is a week of
/// frames at 25 Hz.
pub(super) const MAX_KEYFRAME_SLOTS: usize = 1 << 24;
