//! Conversion of parameter values from YAML and to messages.

use std::borrow::Cow;
use stillpoint::ros_messages::ParameterValue;
use yaml_rust2::{Yaml, YamlLoader};

/// The value of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// True or false.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A real number.
    Double(f64),
    /// Text.
    Text(String),
    /// Whole numbers.
    Integers(Vec<i64>),
    /// Real numbers.
    Doubles(Vec<f64>),
    /// Texts.
    Texts(Vec<String>),
}

impl Value {
    /// Parses the YAML after `:=`.
    ///
    /// # Errors
    /// Invalid values.
    pub fn parse(text: &str) -> Result<Self, String> {
        let found = YamlLoader::load_from_str(text)
            .map_err(|e| format!("expected a value in YAML, found: {e}"))?;
        match found.first() {
            None => Ok(Self::Text(String::new())),
            Some(yaml) => Self::of_yaml(yaml),
        }
    }

    /// From a YAML node.
    ///
    /// # Errors
    /// Invalid values.
    pub fn of_yaml(yaml: &Yaml) -> Result<Self, String> {
        Ok(match yaml {
            Yaml::Boolean(b) => Self::Bool(*b),
            Yaml::Integer(i) => Self::Integer(*i),
            Yaml::Real(text) => Self::Double(
                yaml.as_f64()
                    .ok_or_else(|| format!("expected a number, found \"{text}\""))?,
            ),
            // YAML 1.1, which ROS uses, has more words for true and false.
            Yaml::String(text) => Self::Text(text.clone()),
            Yaml::Null => Self::Text(String::new()),
            Yaml::Array(items) => Self::list(items)?,
            other => {
                return Err(format!(
                    "expected true or false, a number, a text or a list of them, found {other:?}"
                ));
            }
        })
    }

    fn list(items: &[Yaml]) -> Result<Self, String> {
        let values: Vec<Self> = items.iter().map(Self::of_yaml).collect::<Result<_, _>>()?;
        let integers: Option<Vec<i64>> = values.iter().map(Self::integer).collect();
        if let Some(integers) = integers.filter(|_| !values.is_empty()) {
            return Ok(Self::Integers(integers));
        }
        let doubles: Option<Vec<f64>> = values.iter().map(Self::double).collect();
        if let Some(doubles) = doubles.filter(|_| !values.is_empty()) {
            return Ok(Self::Doubles(doubles));
        }
        let text = |v: &Self| match v {
            Self::Text(t) => Some(t.clone()),
            _ => None,
        };
        let texts: Option<Vec<String>> = values.iter().map(text).collect();
        texts
            .map(Self::Texts)
            .ok_or_else(|| "expected a list of values of one kind, found a mixed one".to_owned())
    }

    fn integer(&self) -> Option<i64> {
        match self {
            Self::Integer(i) => Some(*i),
            _ => None,
        }
    }

    /// A number, whole or not.
    #[must_use]
    pub fn double(&self) -> Option<f64> {
        match self {
            Self::Integer(i) => Some(*i as f64),
            Self::Double(d) => Some(*d),
            _ => None,
        }
    }

    /// Name of the type, for messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Bool(_) => "true or false",
            Self::Integer(_) => "a whole number",
            Self::Double(_) => "a number",
            Self::Text(_) => "a text",
            Self::Integers(_) => "a list of whole numbers",
            Self::Doubles(_) => "a list of numbers",
            Self::Texts(_) => "a list of texts",
        }
    }

    /// Number of the type in `rcl_interfaces/msg/ParameterType`.
    #[must_use]
    pub fn type_number(&self) -> u8 {
        match self {
            Self::Bool(_) => 1,
            Self::Integer(_) => 2,
            Self::Double(_) => 3,
            Self::Text(_) => 4,
            Self::Integers(_) => 7,
            Self::Doubles(_) => 8,
            Self::Texts(_) => 9,
        }
    }

    /// Converts it to a message.
    #[must_use]
    pub fn to_message(&self) -> ParameterValue<'static> {
        let mut message = ParameterValue {
            r#type: self.type_number(),
            ..ParameterValue::default()
        };
        match self.clone() {
            Self::Bool(b) => message.bool_value = b,
            Self::Integer(i) => message.integer_value = i,
            Self::Double(d) => message.double_value = d,
            Self::Text(t) => message.string_value = t.into(),
            Self::Integers(l) => message.integer_array_value = l,
            Self::Doubles(l) => message.double_array_value = l,
            Self::Texts(l) => message.string_array_value = l.into_iter().map(Cow::Owned).collect(),
        }
        message
    }

    /// From a message; `None` if it is unset, or a list of bytes or truth values, which no parameter here has.
    #[must_use]
    pub fn of_message(message: &ParameterValue<'_>) -> Option<Self> {
        Some(match message.r#type {
            1 => Self::Bool(message.bool_value),
            2 => Self::Integer(message.integer_value),
            3 => Self::Double(message.double_value),
            4 => Self::Text(message.string_value.clone().into_owned()),
            7 => Self::Integers(message.integer_array_value.clone()),
            8 => Self::Doubles(message.double_array_value.clone()),
            9 => Self::Texts(
                message
                    .string_array_value
                    .iter()
                    .map(|t| t.clone().into_owned())
                    .collect(),
            ),
            _ => return None,
        })
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(b) => write!(f, "{b}"),
            Self::Integer(i) => write!(f, "{i}"),
            Self::Double(d) => write!(f, "{d:?}"),
            Self::Text(t) => write!(f, "\"{t}\""),
            Self::Integers(l) => write!(f, "{l:?}"),
            Self::Doubles(l) => write!(f, "{l:?}"),
            Self::Texts(l) => write!(f, "{l:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_parse_as_yaml_and_round_trip_as_messages() {
        for (text, value) in [
            ("true", Value::Bool(true)),
            ("-3", Value::Integer(-3)),
            ("1e-3", Value::Double(1e-3)),
            ("base_link", Value::Text("base_link".into())),
            ("'7'", Value::Text("7".into())),
            ("[1, 2]", Value::Integers(vec![1, 2])),
            ("[1, 2.5]", Value::Doubles(vec![1.0, 2.5])),
            ("[a, b]", Value::Texts(vec!["a".into(), "b".into()])),
            ("", Value::Text(String::new())),
            ("/tmp/a b.mcap", Value::Text("/tmp/a b.mcap".into())),
        ] {
            assert_eq!(Value::parse(text).as_ref(), Ok(&value), "{text}");
            assert_eq!(Value::of_message(&value.to_message()), Some(value));
        }
        assert!(Value::parse("[1, a]").is_err());
        assert!(Value::parse("{a: 1}").is_err());
        assert_eq!(Value::of_message(&ParameterValue::default()), None);
    }
}
