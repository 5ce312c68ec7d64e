//! Public data sets that commands accept by name.

use clap::ValueEnum;

/// A public data set with moving people and objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// TUM RGB-D, dynamic objects: freiburg3 walking and sitting, freiburg2 desk with person
    TumDynamic,
    /// Bonn RGB-D Dynamic
    Bonn,
}

impl Suite {
    /// The name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::TumDynamic => "tum-dynamic",
            Self::Bonn => "bonn",
        }
    }
}
