//! Names of ROS 2: validation, expansion, remapping, and names on the wire.
//!
//! Rules: "Topic and Service name mapping to DDS" and "Static Remapping" of design.ros2.org.

/// Name and namespace of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeName {
    /// `/` or `/robot1`.
    pub namespace: String,
    /// `stillpoint`.
    pub name: String,
}

impl NodeName {
    /// With its namespace: `/robot1/stillpoint`.
    #[must_use]
    pub fn full(&self) -> String {
        join(&self.namespace, &self.name)
    }
}

fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

/// Validates a name: letters, digits and underscores in parts that do not begin with a digit.
///
/// # Errors
/// Invalid names.
pub fn check(name: &str) -> Result<(), String> {
    let body = name.strip_prefix("~/").unwrap_or(name);
    let body = body.strip_prefix('/').unwrap_or(body);
    let is_part = |part: &str| {
        let mut chars = part.chars();
        chars
            .next()
            .is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
            && chars.all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    if body.split('/').all(is_part) && !body.contains("__") && !body.ends_with('_') {
        return Ok(());
    }
    Err(format!(
        "expected a name of letters, digits and single underscores in parts between slashes, found \"{name}\""
    ))
}

/// Expands a name: `~/map` is in the node's own namespace, `map` in the namespace of the node, `/map` is absolute.
#[must_use]
pub fn expand(name: &str, node: &NodeName) -> String {
    if let Some(own) = name.strip_prefix("~/") {
        join(&node.full(), own)
    } else if name.starts_with('/') {
        name.to_owned()
    } else {
        join(&node.namespace, name)
    }
}

/// A rule `from:=to` of `--ros-args -r`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remap {
    /// The node it applies to; `None` for every node.
    pub node: Option<String>,
    /// Original name.
    pub from: String,
    /// New name.
    pub to: String,
}

/// The full name of a topic or service, after the first rule that matches.
#[must_use]
pub fn resolve(name: &str, node: &NodeName, rules: &[Remap]) -> String {
    let full = expand(name, node);
    let hit = rules.iter().find(|rule| {
        let for_us = rule.node.as_ref().is_none_or(|n| *n == node.name);
        let kind = rule.from.strip_prefix("rostopic://");
        let kind = kind.or_else(|| rule.from.strip_prefix("rosservice://"));
        for_us && !rule.from.starts_with("__") && expand(kind.unwrap_or(&rule.from), node) == full
    });
    hit.map_or(full, |rule| expand(&rule.to, node))
}

/// The topic on the wire: `/tf` is `rt/tf`.
#[must_use]
pub fn topic_on_wire(name: &str) -> String {
    format!("rt{name}")
}

/// The two topics of a service: `/stillpoint/reset` is `rq/stillpoint/resetRequest` and `rr/stillpoint/resetReply`.
#[must_use]
pub fn service_on_wire(name: &str) -> [String; 2] {
    [format!("rq{name}Request"), format!("rr{name}Reply")]
}

/// A type on the wire: `sensor_msgs/msg/Image` is `sensor_msgs::msg::dds_::Image_`.
#[must_use]
pub fn type_on_wire(name: &str) -> String {
    match name.rsplit_once('/') {
        Some((package, message)) => format!("{}::dds_::{message}_", package.replace('/', "::")),
        None => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(namespace: &str) -> NodeName {
        NodeName {
            namespace: namespace.to_owned(),
            name: "stillpoint".to_owned(),
        }
    }

    #[test]
    fn relative_names_are_expanded() {
        for (name, root, robot) in [
            ("odometry", "/odometry", "/robot1/odometry"),
            (
                "~/odometry",
                "/stillpoint/odometry",
                "/robot1/stillpoint/odometry",
            ),
            ("/tf", "/tf", "/tf"),
            ("a/b", "/a/b", "/robot1/a/b"),
        ] {
            assert_eq!(expand(name, &node("/")), root);
            assert_eq!(expand(name, &node("/robot1")), robot);
        }
    }

    #[test]
    fn remap_rules_apply_in_any_spelling() {
        let rule = |node: Option<&str>, from: &str, to: &str| Remap {
            node: node.map(str::to_owned),
            from: from.to_owned(),
            to: to.to_owned(),
        };
        let rules = [
            rule(Some("other"), "odometry", "/wrong"),
            rule(Some("stillpoint"), "~/odometry", "odom"),
            rule(None, "/tf", "tf"),
            rule(None, "rostopic://camera/image", "/front/image"),
            rule(None, "__ns", "/robot1"),
        ];
        let node = node("/robot1");
        assert_eq!(resolve("~/odometry", &node, &rules), "/robot1/odom");
        assert_eq!(resolve("/tf", &node, &rules), "/robot1/tf");
        assert_eq!(resolve("/tf_static", &node, &rules), "/tf_static");
        assert_eq!(resolve("camera/image", &node, &rules), "/front/image");
        assert_eq!(resolve("odometry", &node, &rules), "/robot1/odometry");
    }

    #[test]
    fn dds_names_follow_the_ros_mapping() {
        assert_eq!(topic_on_wire("/tf"), "rt/tf");
        assert_eq!(
            service_on_wire("/stillpoint/reset"),
            ["rq/stillpoint/resetRequest", "rr/stillpoint/resetReply"]
        );
        assert_eq!(
            type_on_wire("sensor_msgs/msg/Image"),
            "sensor_msgs::msg::dds_::Image_"
        );
        assert_eq!(
            type_on_wire("std_srvs/srv/Trigger_Request"),
            "std_srvs::srv::dds_::Trigger_Request_"
        );
    }

    #[test]
    fn invalid_names_are_reported() {
        for good in ["~/a", "/a/b_1", "a", "/tf", "_private"] {
            assert_eq!(check(good), Ok(()), "{good}");
        }
        for bad in ["", "/", "1a", "a b", "a//b", "a-b", "a__b", "a/", "~"] {
            let told = check(bad).unwrap_err();
            assert!(
                told.contains("expected") && told.contains("found"),
                "{told}"
            );
        }
    }
}
