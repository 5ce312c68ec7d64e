//! Quality of service.

use rustdds::policy::{Durability, History, Reliability};
use rustdds::{QosPolicies, QosPolicyBuilder};

/// Quality of service of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Lost packets are retransmitted.
    pub reliable: bool,
    /// Late subscribers receive earlier messages.
    pub latched: bool,
    /// Maximum queue length.
    pub depth: u16,
}

impl Quality {
    /// For sensors: best effort.
    pub const SENSOR: Self = Self {
        reliable: false,
        latched: false,
        depth: 10,
    };
    /// For inertial sensors and odometry: queues half a second at 400 Hz.
    pub const INERTIAL: Self = Self {
        depth: 200,
        ..Self::SENSOR
    };
    /// The default of ROS 2.
    pub const DEFAULT: Self = Self {
        reliable: true,
        latched: false,
        depth: 10,
    };
    /// For maps and constant transforms.
    pub const LATCHED: Self = Self {
        reliable: true,
        latched: true,
        depth: 1,
    };

    pub(crate) fn policies(self) -> QosPolicies {
        let reliability = if self.reliable {
            Reliability::Reliable {
                max_blocking_time: rustdds::Duration::from_millis(100),
            }
        } else {
            Reliability::BestEffort
        };
        let durability = if self.latched {
            Durability::TransientLocal
        } else {
            Durability::Volatile
        };
        QosPolicyBuilder::new()
            .reliability(reliability)
            .durability(durability)
            .history(History::KeepLast {
                depth: self.depth.into(),
            })
            .build()
    }
}
