//! Parameter files, parsed as by rcl.

use crate::names::NodeName;
use crate::value::Value;
use std::path::Path;
use stillpoint::datasets::read_regular_text;
use yaml_rust2::{Yaml, YamlLoader};

/// Maximum size of a parameter file, bytes.
const LARGEST: u64 = 1 << 22;

/// The entries for `/**`, the node's name, or its name with namespace, in the order of the file.
pub(super) fn read(path: &Path, node: &NodeName) -> Result<Vec<(String, Value)>, String> {
    let refuse = |expected: &str, found: &dyn std::fmt::Display| {
        format!(
            "{}: expected {expected}, found: {found}; see docs/ros2.md",
            path.display()
        )
    };
    let text = read_regular_text(path, LARGEST).map_err(|e| refuse("a file of parameters", &e))?;
    let documents = YamlLoader::load_from_str(&text).map_err(|e| refuse("YAML", &e))?;
    let mut found = Vec::new();
    for document in &documents {
        let Yaml::Hash(_) = document else {
            return Err(refuse(
                "names of nodes with ros__parameters",
                &"something else",
            ));
        };
        nodes(document, "", node, &mut found).map_err(|e| refuse("parameters", &e))?;
    }
    Ok(found)
}

/// Names of nodes may be nested by namespaces.
fn nodes(
    yaml: &Yaml,
    prefix: &str,
    node: &NodeName,
    to: &mut Vec<(String, Value)>,
) -> Result<(), String> {
    let Yaml::Hash(entries) = yaml else {
        return Ok(());
    };
    for (key, inner) in entries {
        let Some(key) = key.as_str() else {
            return Err("a key that is no text".to_owned());
        };
        if key == "ros__parameters" {
            if is_for(prefix, node) {
                values(inner, "", to)?;
            }
        } else {
            nodes(
                inner,
                &format!("{prefix}/{}", key.trim_matches('/')),
                node,
                to,
            )?;
        }
    }
    Ok(())
}

fn is_for(pattern: &str, node: &NodeName) -> bool {
    let full = node.full();
    let full: Vec<&str> = full.split('/').filter(|p| !p.is_empty()).collect();
    let parts: Vec<&str> = pattern.split('/').filter(|p| !p.is_empty()).collect();
    matches(&parts, &full) || (parts == [node.name.as_str()] && node.namespace == "/")
}

/// `*` matches one part of a name, `**` any number of them.
fn matches(pattern: &[&str], name: &[&str]) -> bool {
    match (pattern.first(), name.first()) {
        (None, None) => true,
        (Some(&"**"), _) => (0..=name.len()).any(|n| matches(&pattern[1..], &name[n..])),
        (Some(p), Some(n)) => (p == n || *p == "*") && matches(&pattern[1..], &name[1..]),
        _ => false,
    }
}

fn values(yaml: &Yaml, prefix: &str, to: &mut Vec<(String, Value)>) -> Result<(), String> {
    let Yaml::Hash(entries) = yaml else {
        return Ok(());
    };
    for (key, inner) in entries {
        let key = key.as_str().ok_or("a name that is no text")?;
        let name = format!("{prefix}{key}");
        match inner {
            Yaml::Hash(_) => values(inner, &format!("{name}."), to)?,
            // Overrides of QoS are not supported.
            _ if name.starts_with("qos_overrides.") => {}
            _ => to.push((
                name.clone(),
                Value::of_yaml(inner).map_err(|e| format!("{name}: {e}"))?,
            )),
        }
    }
    Ok(())
}
