//! Declares the scene's keys as parameters of the node, with their dotted paths, from the registry of keys.

use ros2_client::ParameterValue;

use needle_core::scene::{Kind, NewValue, Override, Scene, Value, file, keys};
use ros2_node::arguments::ParameterOverride;
use ros2_node::names;
use ros2_node::parameters::{self, Declaration, Range};
use ros2_node::start::NodeError;

/// A scene by the name of a preset or by a path.
///
/// # Errors
/// [`NodeError`] if it is neither, or the file is not valid.
pub(crate) fn load(name_or_path: &str) -> Result<Scene, NodeError> {
    file::load(name_or_path).map_err(NodeError::program)
}

/// One declaration per key that applies to the scene; the scene's own value is the default. The description is prose, which
/// `ros2 param load` would take for YAML.
#[must_use]
pub(crate) fn declarations(scene: &Scene) -> Vec<Declaration> {
    scene
        .entries()
        .into_iter()
        .filter(|(path, _)| path != "description")
        .filter_map(|(path, value)| {
            let key = keys::find(&path)?;
            let default = to_parameter(&value);
            let range = match key.kind {
                // The closed interval; the scene itself rejects excluded ends.
                Kind::Real(range) if matches!(value, Value::Real(_)) => Range::Double(range.low, range.high),
                Kind::Integer(low, high) => Range::Integer(low, high),
                _ => Range::Any,
            };
            let unit = if key.unit.is_empty() { String::new() } else { format!(" Unit: {}.", key.unit) };
            let mut declaration =
                Declaration::new(&path, default, range, &format!("{}{unit}", key.description)).fixed();
            declaration.constraints = key.allowed();
            Some(declaration)
        })
        .collect()
}

/// The scene with the keys that the command line changes for this node.
///
/// # Errors
/// [`NodeError::Program`] if the scene rejects a value.
pub(crate) fn apply(scene: &Scene, overrides: &[ParameterOverride], node: &str) -> Result<Scene, NodeError> {
    let changes: Vec<Override> = overrides
        .iter()
        .filter(|o| names::pattern_matches(&o.node_pattern, node) && keys::find(&o.name).is_some())
        .map(|o| match to_value(&o.value) {
            Some(value) => Override { path: o.name.clone(), value: NewValue::Typed(value), place: o.origin.clone() },
            None => Override::text(&o.name, &parameters::show(&o.value), &o.origin),
        })
        .collect();
    scene.with(&changes).map_err(NodeError::program)
}

fn to_parameter(value: &Value) -> ParameterValue {
    match value {
        Value::Text(v) => ParameterValue::String(v.clone()),
        Value::Real(v) => ParameterValue::Double(*v),
        Value::Integer(v) => ParameterValue::Integer(*v),
        Value::Boolean(v) => ParameterValue::Boolean(*v),
        Value::Point(v) => ParameterValue::DoubleArray(v.to_vec()),
        Value::List(v) => ParameterValue::DoubleArray(v.clone()),
    }
}

#[allow(clippy::cast_precision_loss)] // coordinates in metres
fn to_value(value: &ParameterValue) -> Option<Value> {
    Some(match value {
        ParameterValue::Boolean(v) => Value::Boolean(*v),
        ParameterValue::Integer(v) => Value::Integer(*v),
        ParameterValue::Double(v) => Value::Real(*v),
        ParameterValue::String(v) => Value::Text(v.clone()),
        ParameterValue::DoubleArray(v) => Value::of_numbers(v.clone()),
        ParameterValue::IntegerArray(v) => Value::of_numbers(v.iter().map(|v| *v as f64).collect()),
        _ => return None,
    })
}
