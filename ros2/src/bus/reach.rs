//! Discovery range, from the environment.

/// Discovery range of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// Only this machine.
    pub local_only: bool,
}

impl Reach {
    /// From the environment: `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, and `ROS_LOCALHOST_ONLY` of older versions, which takes
    /// precedence.
    ///
    /// # Errors
    /// Invalid values.
    pub fn of_environment(get: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let set = |name: &str| get(name).filter(|v| !v.is_empty());
        let domain = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => text
                .trim()
                .parse()
                .ok()
                .filter(|d| *d <= 232)
                .ok_or_else(|| {
                    format!("ROS_DOMAIN_ID: expected a number from 0 to 232, found \"{text}\"")
                })?,
        };
        let only = set("ROS_LOCALHOST_ONLY").map(|v| v == "1");
        let range = set("ROS_AUTOMATIC_DISCOVERY_RANGE").map(|v| v.to_ascii_uppercase());
        let by_range = match range.as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT" | "NOT_SET") => false,
            // Either way there is no multicast discovery; nodes on this machine are found by their ports.
            Some("LOCALHOST" | "OFF") => true,
            Some(other) => {
                return Err(format!(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE: expected SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT, found \"{other}\""
                ));
            }
        };
        Ok(Self {
            domain,
            local_only: only.unwrap_or(by_range),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reach(set: &[(&str, &str)]) -> Result<Reach, String> {
        Reach::of_environment(|name| {
            let found = set.iter().find(|(n, _)| *n == name);
            found.map(|(_, v)| (*v).to_owned())
        })
    }

    #[test]
    fn discovery_range_follows_the_environment() {
        let expect = |set: &[(&str, &str)], domain, local_only| {
            assert_eq!(reach(set), Ok(Reach { domain, local_only }), "{set:?}");
        };
        expect(&[], 0, false);
        expect(&[("ROS_DOMAIN_ID", "42")], 42, false);
        expect(&[("ROS_LOCALHOST_ONLY", "1")], 0, true);
        expect(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")], 0, true);
        expect(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "subnet")], 0, false);
        let both = [
            ("ROS_LOCALHOST_ONLY", "0"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ];
        expect(&both, 0, false);
        assert!(reach(&[("ROS_DOMAIN_ID", "233")]).is_err());
        assert!(reach(&[("ROS_DOMAIN_ID", "x")]).is_err());
        assert!(reach(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "MOON")]).is_err());
    }
}
