// What any command line must do, whatever it says: shared by the fuzz target in `fuzz/` and by `tests/ros/ros_arguments.rs`.

use std::ffi::OsString;

use ros2_client::ParameterValue;
use ros2_node::arguments::{self, RosArguments};
use ros2_node::names::{Endpoint, Names, check_name, check_namespace, check_token};
use ros2_node::parameter::Parameter;
use ros2_node::parameters::Parameters;
use ros2_node::{parameter_file, qos};

/// Arguments are the lines of `data`; what stands behind a line `---` is a parameter file.
pub fn exercise(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let (line, file) = text.split_once("\n---\n").unwrap_or((&text, ""));
    let _ = parameter_file::from_text(file, std::path::Path::new("fuzz.yaml")).map(|found| declare(&found));
    // A file that the fuzzer names is none of its business.
    let words = line.lines().filter(|w| *w != "--params-file").map(OsString::from);
    match arguments::split(words) {
        Ok((own, ros)) => accepted(&own, &ros),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn accepted(own: &[String], ros: &RosArguments) {
    assert!(!own.iter().any(|word| word == "--ros-args"), "ROS arguments are taken out");
    declare(&ros.parameters);
    let Ok(names) = Names::new("twin", &ros.remaps) else { return };
    assert!(check_token(names.node()).is_ok() && check_namespace(names.namespace()).is_ok());
    for name in ["measured_js", "~/reset", "/clock", "a/b", "~"] {
        for endpoint in [Endpoint::Topic, Endpoint::Service] {
            let Ok(full) = names.resolve(name, endpoint) else { continue };
            assert!(full.starts_with('/') && check_name(&full).is_ok(), "{name} became {full}");
        }
    }
}

/// Declared parameters have their type, whatever was given.
fn declare(given: &[arguments::ParameterOverride]) {
    for one in given {
        if let Some((_, _, policy)) = qos::parse_override_name(&one.name) {
            let _ = qos::apply(&mut qos::sensor(1), policy, &one.value);
        }
    }
    const RATE: Parameter<f64> = Parameter::real("rate", 1.0, [0.0, 10.0], "A rate.");
    const SCENE: Parameter<String> = Parameter::new("scene", "a", "A name.");
    const TOPICS: Parameter<Vec<String>> = Parameter::new("topics", [], "Names.");
    let declared = vec![RATE.declaration(), SCENE.declaration(), TOPICS.declaration()];
    if let Ok((parameters, _)) = Parameters::declare(declared, given, "/or1/twin") {
        assert!((0.0..=10.0).contains(&parameters.get(RATE)));
        assert!(matches!(parameters.by_name(TOPICS.name()), Some(ParameterValue::StringArray(_))));
    }
}
