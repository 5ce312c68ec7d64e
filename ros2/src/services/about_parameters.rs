//! Services for parameters (`rcl_interfaces`).

use super::{Kind, bytes, read};
use crate::parameters::Parameters;
use crate::value::Value;
use std::borrow::Cow;
use stillpoint::ros_messages as ros;

/// The answer to a request about parameters; none to an unreadable one, as with any node.
pub(super) fn about_parameters(
    kind: Kind,
    request: &[u8],
    parameters: &mut Parameters,
    changed: &mut Vec<(String, Value)>,
) -> Option<Vec<u8>> {
    Some(match kind {
        Kind::Get => {
            let names = read::<ros::GetParametersRequest<'_>>(request)?.names;
            let value = |name: &Cow<'_, str>| parameters.get(name).map(Value::to_message);
            let values = names.iter().map(|n| value(n).unwrap_or_default()).collect();
            bytes(&ros::GetParametersResponse { values })
        }
        Kind::GetTypes => {
            let names = read::<ros::GetParameterTypesRequest<'_>>(request)?.names;
            let number = |n: &Cow<'_, str>| parameters.get(n).map_or(0, Value::type_number);
            let types: Vec<u8> = names.iter().map(number).collect();
            bytes(&ros::GetParameterTypesResponse {
                types: types.into(),
            })
        }
        Kind::List => {
            let asked: ros::ListParametersRequest<'_> = read(request)?;
            bytes(&ros::ListParametersResponse {
                result: list(parameters, &asked),
            })
        }
        Kind::Describe => {
            let names = read::<ros::DescribeParametersRequest<'_>>(request)?.names;
            let descriptors = names.iter().map(|n| describe(parameters, n)).collect();
            bytes(&ros::DescribeParametersResponse { descriptors })
        }
        Kind::Set => {
            let asked = read::<ros::SetParametersRequest<'_>>(request)?.parameters;
            let mut set =
                |p: &ros::Parameter<'_>| result(set(parameters, std::slice::from_ref(p), changed));
            let results = asked.iter().map(&mut set).collect();
            bytes(&ros::SetParametersResponse { results })
        }
        Kind::SetAtomically => {
            let asked = read::<ros::SetParametersAtomicallyRequest<'_>>(request)?.parameters;
            let result = result(set(parameters, &asked, changed));
            bytes(&ros::SetParametersAtomicallyResponse { result })
        }
        _ => return None,
    })
}

fn set(
    parameters: &mut Parameters,
    asked: &[ros::Parameter<'_>],
    changed: &mut Vec<(String, Value)>,
) -> Result<(), String> {
    let value = |p: &ros::Parameter<'_>| {
        let value = Value::of_message(&p.value).ok_or_else(|| {
            format!(
                "{}: expected a value, found none; parameters cannot be unset",
                p.name
            )
        })?;
        Ok((p.name.clone().into_owned(), value))
    };
    let values: Vec<(String, Value)> = asked.iter().map(value).collect::<Result<_, String>>()?;
    parameters.set_all(&values)?;
    changed.extend(values);
    Ok(())
}

fn result(of: Result<(), String>) -> ros::SetParametersResult<'static> {
    ros::SetParametersResult {
        successful: of.is_ok(),
        reason: of.err().unwrap_or_default().into(),
    }
}

/// Names below the prefixes up to the requested depth, and all existing prefixes.
fn list(
    parameters: &Parameters,
    asked: &ros::ListParametersRequest<'_>,
) -> ros::ListParametersResult<'static> {
    let dots = |text: &str| text.matches('.').count() as u64;
    let below = |name: &str, prefix: &str| {
        let inner = name.strip_prefix(prefix).and_then(|r| r.strip_prefix('.'));
        inner.is_some_and(|rest| asked.depth == 0 || dots(rest) < asked.depth)
    };
    let wanted = |name: &str| {
        if asked.prefixes.is_empty() {
            return asked.depth == 0 || dots(name) < asked.depth;
        }
        asked.prefixes.iter().any(|p| name == p || below(name, p))
    };
    let names: Vec<&str> = parameters.names().filter(|n| wanted(n)).collect();
    let mut prefixes: Vec<&str> = names
        .iter()
        .filter_map(|n| n.rsplit_once('.').map(|(prefix, _)| prefix))
        .collect();
    prefixes.dedup();
    let owned = |list: Vec<&str>| list.into_iter().map(|n| n.to_owned().into()).collect();
    ros::ListParametersResult {
        names: owned(names),
        prefixes: owned(prefixes),
    }
}

fn describe(parameters: &Parameters, name: &str) -> ros::ParameterDescriptor<'static> {
    let mut descriptor = ros::ParameterDescriptor {
        name: name.to_owned().into(),
        ..ros::ParameterDescriptor::default()
    };
    if let Some(parameter) = parameters.parameter(name) {
        use crate::options::Counts;
        descriptor.r#type = parameter.value.type_number();
        descriptor.description = parameter.text.clone().into();
        descriptor.additional_constraints = match parameter.counts {
            Counts::AtOnce => "",
            Counts::NextRun => "Counts from the next reset on.",
            Counts::AtStart => "Counts only when the node starts.",
        }
        .into();
        descriptor.read_only = parameters.is_read_only(name);
    }
    descriptor
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::ros_messages::Wire;

    fn call<'a, T: Wire<'a>>(kind: Kind, request: &T, parameters: &mut Parameters) -> Vec<u8> {
        about_parameters(kind, &bytes(request), parameters, &mut Vec::new()).unwrap()
    }

    #[test]
    fn parameters_are_read_listed_and_described() {
        let mut p = Parameters::default();
        let names = vec!["max_dt".into(), "no_such".into(), "detector.stride".into()];
        let answer = call(
            Kind::Get,
            &ros::GetParametersRequest {
                names: names.clone(),
            },
            &mut p,
        );
        let values = read::<ros::GetParametersResponse<'_>>(&answer)
            .unwrap()
            .values;
        assert_eq!(values[0].double_value, 0.02);
        assert_eq!((values[1].r#type, values[2].integer_value), (0, 1));
        let answer = call(
            Kind::GetTypes,
            &ros::GetParameterTypesRequest {
                names: names.clone(),
            },
            &mut p,
        );
        let types = read::<ros::GetParameterTypesResponse<'_>>(&answer)
            .unwrap()
            .types;
        assert_eq!(types[..], [3, 0, 2]);
        let answer = call(
            Kind::Describe,
            &ros::DescribeParametersRequest { names },
            &mut p,
        );
        let described = read::<ros::DescribeParametersResponse<'_>>(&answer)
            .unwrap()
            .descriptors;
        assert!(described[0].description.contains("stamps"));
        let of = |prefixes: Vec<Cow<'static, str>>, depth| ros::ListParametersRequest {
            prefixes,
            depth,
        };
        let names = |answer: &[u8]| {
            let result = read::<ros::ListParametersResponse<'_>>(answer)
                .unwrap()
                .result;
            let names = result.names.iter().map(|n| n.to_string());
            (names.collect::<Vec<_>>(), result.prefixes.len())
        };
        let (all, prefixes) = names(&call(Kind::List, &of(vec![], 0), &mut p));
        assert!(all.len() > 50 && prefixes > 5);
        let (some, _) = names(&call(Kind::List, &of(vec!["detector".into()], 0), &mut p));
        assert_eq!(some, ["detector.stride"]);
        let (top, prefixes) = names(&call(Kind::List, &of(vec![], 1), &mut p));
        assert!(top.iter().all(|n| !n.contains('.')) && prefixes == 0);
    }

    #[test]
    fn parameters_are_set_individually_or_atomically() {
        let mut p = Parameters::default();
        let one = |name: &'static str, value: Value| ros::Parameter {
            name: name.into(),
            value: value.to_message(),
        };
        let parameters = vec![
            one("seed", Value::Integer(4)),
            one("seeds", Value::Integer(4)),
        ];
        let request = ros::SetParametersAtomicallyRequest {
            parameters: parameters.clone(),
        };
        let answer = call(Kind::SetAtomically, &request, &mut p);
        let result = read::<ros::SetParametersAtomicallyResponse<'_>>(&answer)
            .unwrap()
            .result;
        assert!(!result.successful && result.reason.contains("seeds"));
        assert_eq!(p.config().seed, 0);
        let mut changed = Vec::new();
        let request = bytes(&ros::SetParametersRequest { parameters });
        let answer = about_parameters(Kind::Set, &request, &mut p, &mut changed).unwrap();
        let results = read::<ros::SetParametersResponse<'_>>(&answer)
            .unwrap()
            .results;
        assert_eq!(
            (results[0].successful, results[1].successful),
            (true, false)
        );
        assert_eq!(p.config().seed, 4);
        assert_eq!(changed, [("seed".to_owned(), Value::Integer(4))]);
    }
}
