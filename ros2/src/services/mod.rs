//! The services of the node: parameter services, and requests to the run.

mod about_parameters;

use crate::bus::{Bus, BusError, Request, Service};
use crate::names::{NodeName, Remap, resolve};
use crate::parameters::Parameters;
use crate::value::Value;
use about_parameters::about_parameters;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, Wire, from_bytes, to_bytes};

/// A request to the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Restart.
    Reset,
    /// Save the map to `map_file`.
    SaveMap,
    /// Continue in the map of `map_file`.
    LoadMap,
    /// Stop or resume changes of the map.
    LocalizeOnly(bool),
    /// Pause or resume.
    Pause(bool),
}

/// A success message, or an error.
pub type Answer = Result<String, String>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Reset,
    SaveMap,
    LoadMap,
    LocalizeOnly,
    Pause,
    Get,
    GetTypes,
    List,
    Describe,
    Set,
    SetAtomically,
}

const TRIGGER: &str = "std_srvs/srv/Trigger";
const SET_BOOL: &str = "std_srvs/srv/SetBool";

const ALL: [(Kind, &str, &str); 11] = [
    (Kind::Reset, "~/reset", TRIGGER),
    (Kind::SaveMap, "~/save_map", TRIGGER),
    (Kind::LoadMap, "~/load_map", TRIGGER),
    (Kind::LocalizeOnly, "~/localize_only", SET_BOOL),
    (Kind::Pause, "~/pause", SET_BOOL),
    (
        Kind::Get,
        "~/get_parameters",
        "rcl_interfaces/srv/GetParameters",
    ),
    (
        Kind::GetTypes,
        "~/get_parameter_types",
        "rcl_interfaces/srv/GetParameterTypes",
    ),
    (
        Kind::List,
        "~/list_parameters",
        "rcl_interfaces/srv/ListParameters",
    ),
    (
        Kind::Describe,
        "~/describe_parameters",
        "rcl_interfaces/srv/DescribeParameters",
    ),
    (
        Kind::Set,
        "~/set_parameters",
        "rcl_interfaces/srv/SetParameters",
    ),
    (
        Kind::SetAtomically,
        "~/set_parameters_atomically",
        "rcl_interfaces/srv/SetParametersAtomically",
    ),
];

/// Of the service, its requests and its answers.
pub(crate) fn hashes() -> Vec<(&'static str, [String; 3])> {
    let mut all: Vec<(&'static str, [String; 3])> = ALL
        .iter()
        .map(|(kind, _, name)| (*name, hashes_of(*kind, name)))
        .collect();
    all.dedup();
    all
}

fn hashes_of(kind: Kind, name: &str) -> [String; 3] {
    use crate::type_hash::of_halves as of;
    match kind {
        Kind::Reset | Kind::SaveMap | Kind::LoadMap => {
            of::<ros::TriggerRequest, ros::TriggerResponse<'_>>(name)
        }
        Kind::LocalizeOnly | Kind::Pause => {
            of::<ros::SetBoolRequest, ros::SetBoolResponse<'_>>(name)
        }
        Kind::Get => of::<ros::GetParametersRequest<'_>, ros::GetParametersResponse<'_>>(name),
        Kind::GetTypes => {
            of::<ros::GetParameterTypesRequest<'_>, ros::GetParameterTypesResponse<'_>>(name)
        }
        Kind::List => of::<ros::ListParametersRequest<'_>, ros::ListParametersResponse<'_>>(name),
        Kind::Describe => {
            of::<ros::DescribeParametersRequest<'_>, ros::DescribeParametersResponse<'_>>(name)
        }
        Kind::Set => of::<ros::SetParametersRequest<'_>, ros::SetParametersResponse<'_>>(name),
        Kind::SetAtomically => of::<
            ros::SetParametersAtomicallyRequest<'_>,
            ros::SetParametersAtomicallyResponse<'_>,
        >(name),
    }
}

/// All service servers.
pub struct Services(Vec<(Kind, Service)>);

/// A pending request to the run.
pub struct Asked {
    /// The request.
    pub ask: Ask,
    service: usize,
    request: Request,
}

impl Services {
    /// Creates all services.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn offer(bus: &mut Bus, node: &NodeName, remaps: &[Remap]) -> Result<Self, BusError> {
        let mut all = Vec::new();
        for (kind, name, type_name) in ALL {
            let service = bus.serve(&resolve(name, node, remaps), type_name)?;
            all.push((kind, service));
        }
        Ok(Self(all))
    }

    /// Answers parameter requests, and returns requests to the run. Appends changed parameters to `changed`.
    pub fn poll(
        &self,
        parameters: &mut Parameters,
        changed: &mut Vec<(String, Value)>,
    ) -> Vec<Asked> {
        let mut asked = Vec::new();
        for (i, (kind, service)) in self.0.iter().enumerate() {
            while let Some(request) = service.take() {
                match ask(*kind, &request.bytes) {
                    Some(ask) => asked.push(Asked {
                        ask,
                        service: i,
                        request,
                    }),
                    None => {
                        if let Some(answer) =
                            about_parameters(*kind, &request.bytes, parameters, changed)
                        {
                            service.answer(&request, &answer);
                        }
                    }
                }
            }
        }
        asked
    }

    /// Answers a request to the run.
    pub fn answer(&self, asked: &Asked, answer: &Answer) {
        let (success, message) = match answer {
            Ok(done) => (true, done),
            Err(why) => (false, why),
        };
        // Answers of `SetBool` and `Trigger` have the same fields.
        let message = ros::TriggerResponse {
            success,
            message: message.as_str().into(),
        };
        if let Some((_, service)) = self.0.get(asked.service) {
            service.answer(&asked.request, &bytes(&message));
        }
    }
}

fn bytes<'a, T: Wire<'a>>(message: &T) -> Vec<u8> {
    to_bytes(message, Format::CdrLittleEndian)
}

fn read<'a, T: Wire<'a>>(bytes: &'a [u8]) -> Option<T> {
    from_bytes(bytes, Format::CdrLittleEndian).ok()
}

fn ask(kind: Kind, request: &[u8]) -> Option<Ask> {
    let flag = || read::<ros::SetBoolRequest>(request).map(|r| r.data);
    match kind {
        Kind::Reset => Some(Ask::Reset),
        Kind::SaveMap => Some(Ask::SaveMap),
        Kind::LoadMap => Some(Ask::LoadMap),
        Kind::LocalizeOnly => flag().map(Ask::LocalizeOnly),
        Kind::Pause => flag().map(Ask::Pause),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_requests_change_nothing() {
        let mut p = Parameters::default();
        for (kind, _, _) in ALL {
            for broken in [&[][..], &[0, 1, 0, 0], &[0, 1, 0, 0, 255, 255, 255, 255, 0]] {
                let _ = about_parameters(kind, broken, &mut p, &mut Vec::new());
                let _ = ask(kind, broken);
            }
        }
        assert_eq!(
            ask(Kind::Pause, &bytes(&ros::SetBoolRequest { data: true })),
            Some(Ask::Pause(true))
        );
    }
}
