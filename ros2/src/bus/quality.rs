//! How messages are delivered.

use rustdds::policy::{Durability, History, Reliability};
use rustdds::{QosPolicies, QosPolicyBuilder};

/// How messages of a topic are delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// What was lost is sent again.
    pub reliable: bool,
    /// Who comes later gets what was sent before.
    pub latched: bool,
    /// Messages that wait at most.
    pub depth: u16,
}

impl Quality {
    /// Of sensors: what is lost is lost.
    pub const SENSOR: Self = Self {
        reliable: false,
        latched: false,
        depth: 10,
    };
    /// Of inertial sensors and odometry: half a second at 400 Hz may wait.
    pub const INERTIAL: Self = Self {
        depth: 200,
        ..Self::SENSOR
    };
    /// What ROS 2 does unless it is told otherwise.
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
