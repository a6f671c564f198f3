//! The six parameter services of every ROS 2 node, for [`Parameters`], and `/parameter_events`.
//!
//! All six are needed: with rmw_cyclonedds, `ros2 param` waits forever if one is missing.

use ros2_client::builtin_interfaces;
use ros2_client::parameters::{ParameterDescriptor, ParameterValue, raw};
use ros2_client::rcl_interfaces as rcl;

use super::clock::NodeClock;
use super::parameters::{Parameters, shown};
use super::participant::{Output, Participant, ParticipantError};
use super::service::Service;

/// The servers. Call [`ParameterServices::poll`] several times per second.
pub struct ParameterServices {
    get: Service<rcl::GetParametersRequest, rcl::GetParametersResponse>,
    types: Service<rcl::GetParameterTypesRequest, rcl::GetParameterTypesResponse>,
    list: Service<rcl::ListParametersRequest, rcl::ListParametersResponse>,
    describe: Service<rcl::DescribeParametersRequest, rcl::DescribeParametersResponse>,
    set: Service<rcl::SetParametersRequest, rcl::SetParametersResponse>,
    set_atomically: Service<rcl::SetParametersRequest, rcl::SetParametersAtomicallyResponse>,
    events: Output<raw::ParameterEvent>,
    node: String,
}

impl ParameterServices {
    /// Creates the six servers of a node.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            get: participant.server("~/get_parameters", "rcl_interfaces", "GetParameters")?,
            types: participant.server("~/get_parameter_types", "rcl_interfaces", "GetParameterTypes")?,
            list: participant.server("~/list_parameters", "rcl_interfaces", "ListParameters")?,
            describe: participant.server("~/describe_parameters", "rcl_interfaces", "DescribeParameters")?,
            set: participant.server("~/set_parameters", "rcl_interfaces", "SetParameters")?,
            set_atomically: participant.server(
                "~/set_parameters_atomically",
                "rcl_interfaces",
                "SetParametersAtomically",
            )?,
            events: participant.parameter_events()?,
            node: participant.names().fully_qualified(),
        })
    }

    /// Answers the pending requests; `changed` is called with every parameter that was set.
    pub fn poll(&self, parameters: &Parameters, clock: &NodeClock, changed: &mut dyn FnMut(&str, &ParameterValue)) {
        self.get.answer(|q| rcl::GetParametersResponse {
            values: q.names.iter().map(|n| raw_value(parameters, n)).collect(),
        });
        self.types.answer(|q| rcl::GetParameterTypesResponse {
            values: q.names.iter().map(|n| raw_value(parameters, n).ptype).collect(),
        });
        self.list.answer(|q| rcl::ListParametersResponse { result: list(parameters, &q.prefixes, q.depth) });
        self.describe.answer(|q| rcl::DescribeParametersResponse {
            values: q
                .names
                .iter()
                .map(|n| parameters.describe(n).unwrap_or_else(|| ParameterDescriptor::unknown(&shown(n))).into())
                .collect(),
        });
        self.set.answer(|q| rcl::SetParametersResponse {
            results: q.parameter.into_iter().map(|p| self.apply(parameters, clock, vec![p], changed)).collect(),
        });
        self.set_atomically.answer(|q| rcl::SetParametersAtomicallyResponse {
            result: self.apply(parameters, clock, q.parameter, changed),
        });
    }

    fn apply(
        &self,
        parameters: &Parameters,
        clock: &NodeClock,
        wanted: Vec<raw::Parameter>,
        changed: &mut dyn FnMut(&str, &ParameterValue),
    ) -> raw::SetParametersResult {
        let wanted: Vec<(String, ParameterValue)> =
            wanted.into_iter().map(|p| (p.name, ParameterValue::from(p.value))).collect();
        match parameters.set(&wanted) {
            Ok(now) => {
                for (name, value) in &now {
                    changed(name, value);
                }
                self.publish(clock, now);
                raw::SetParametersResult { successful: true, reason: String::new() }
            }
            Err((name, reason)) => {
                raw::SetParametersResult { successful: false, reason: format!("parameter `{}` {reason}", shown(&name)) }
            }
        }
    }

    fn publish(&self, clock: &NodeClock, changed: Vec<(String, ParameterValue)>) {
        let event = raw::ParameterEvent {
            stamp: builtin_interfaces::Time::from_nanos(clock.now_nanos().unwrap_or(0)),
            node: self.node.clone(),
            new_parameters: Vec::new(),
            changed_parameters: changed
                .into_iter()
                .map(|(name, value)| raw::Parameter { name, value: value.into() })
                .collect(),
            deleted_parameters: Vec::new(),
        };
        self.events.send(event);
    }
}

fn raw_value(parameters: &Parameters, name: &str) -> raw::ParameterValue {
    parameters.by_name(name).unwrap_or(ParameterValue::NotSet).into()
}

/// Semantics of rclcpp: without prefixes, names with fewer than `depth` dots (0: all); otherwise names at or below a
/// prefix.
fn list(parameters: &Parameters, prefixes: &[String], depth: u64) -> rcl::ListParametersResult {
    let shallow = |name: &str| depth == 0 || (name.matches('.').count() as u64) < depth;
    let wanted = |name: &str| {
        if prefixes.is_empty() {
            return shallow(name);
        }
        prefixes.iter().any(|prefix| {
            name == prefix
                || name.strip_prefix(prefix.as_str()).and_then(|rest| rest.strip_prefix('.')).is_some_and(shallow)
        })
    };
    let names: Vec<String> = parameters.names().into_iter().filter(|name| wanted(name)).collect();
    let mut prefixes: Vec<String> =
        names.iter().filter_map(|name| name.rsplit_once('.')).map(|(prefix, _)| prefix.to_owned()).collect();
    prefixes.dedup();
    rcl::ListParametersResult { names, prefixes }
}
