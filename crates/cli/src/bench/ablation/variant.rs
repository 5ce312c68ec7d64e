//! The configurations of an ablation.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Variant {
    None,
    O,
    G,
    Og,
    /// Objects, epipolar constraint and depth: the complete published method.
    Ogd,
    Default,
}

impl Variant {
    /// In the order of the report.
    pub(crate) const ALL: [Self; 6] = [
        Self::None,
        Self::O,
        Self::G,
        Self::Og,
        Self::Ogd,
        Self::Default,
    ];

    pub(crate) fn label(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::O => "O",
            Self::G => "G",
            Self::Og => "O+G",
            Self::Ogd => "O+G+D",
            Self::Default => "default",
        }
    }

    /// Without a detector such a variant equals one with fewer parts.
    pub(crate) fn needs_detector(self) -> bool {
        matches!(self, Self::O | Self::Og | Self::Ogd)
    }

    /// Settings of this variant; they override the user's.
    fn settings(self) -> Vec<String> {
        let paper = || {
            vec![
                "static_filter.preset=paper".to_owned(),
                format!("static_filter.parts=\"{}\"", self.label()),
            ]
        };
        match self {
            Self::None => vec!["static_filter.preset=off".to_owned()],
            Self::O | Self::G | Self::Og | Self::Ogd => paper(),
            Self::Default => vec!["static_filter.preset=default".to_owned()],
        }
    }
}

/// How the runs of a cell differ from the user's settings.
#[derive(Clone, Debug)]
pub(crate) struct Asked {
    pub(crate) label: &'static str,
    /// Settings, which override the user's.
    pub(crate) settings: Vec<String>,
    /// With a thread per stage, at camera rate.
    pub(crate) live: bool,
}

impl From<Variant> for Asked {
    fn from(variant: Variant) -> Self {
        Self {
            label: variant.label(),
            settings: variant.settings(),
            live: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::ConfigArgs;
    use crate::config;

    #[test]
    fn variant_settings_give_the_labelled_configuration() {
        for variant in Variant::ALL {
            let args = ConfigArgs {
                set: variant.settings(),
                ..ConfigArgs::default()
            };
            let f = config::resolve(&args).unwrap().static_filter;
            let parts = String::from(f.parts);
            let preset = format!("{:?}", f.preset).to_lowercase();
            match variant {
                Variant::None => assert_eq!(preset, "off"),
                Variant::Default => assert_eq!(preset, variant.label()),
                _ => assert_eq!(
                    (preset.as_str(), parts.as_str()),
                    ("paper", variant.label())
                ),
            }
        }
    }
}
