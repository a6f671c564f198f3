//! Contract of bad input: exit code 1 or 2, one message on stderr that names the culprit, no panic, and nothing
//! half-written left behind.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use crate::rig_bag::RigBag;
use assert_cmd::Command;
use proptest::prelude::*;
use tempfile::TempDir;

fn needle_twin() -> Command {
    Command::new(env!("CARGO_BIN_EXE_needle_twin"))
}

/// Runs a command that must be refused, with `--out` where it takes one, and gives what it says.
fn refused(arguments: &[&str]) -> String {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    let mut command = needle_twin();
    command.args(arguments);
    if matches!(arguments.first(), Some(&"solve" | &"replay")) && !arguments.contains(&"--out") {
        command.arg("--out").arg(&out);
    }
    let output = command.output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    let code = output.status.code();
    assert!(matches!(code, Some(1 | 2)), "{arguments:?}: exit code {code:?}: {stderr}");
    assert!(!stderr.contains("panicked"), "{arguments:?}: {stderr}");
    assert_eq!(stderr.matches("error:").count(), 1, "{arguments:?}: one message: {stderr}");
    assert!(output.stdout.is_empty(), "{arguments:?}: a result was printed: {:?}", output.stdout);
    assert!(!out.exists(), "{arguments:?}: output was left behind");
    stderr
}

fn assert_names(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{part}\" is not named in: {message}");
    }
}

/// A file with this content, and the folder that keeps it alive.
fn file(name: &str, content: &[u8]) -> (TempDir, String) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    let path = path.to_str().unwrap().to_owned();
    (folder, path)
}

#[test]
fn settings_that_no_scene_can_have() {
    for (setting, parts) in [
        (
            "material.poison_ratio=0.3",
            &["--set", "material.poison_ratio", "0.3", "material.poisson_ratio", "(-1, 0.5)"] as &[&str],
        ),
        ("material.poisson_ratio=0.5", &["material.poisson_ratio", "0.5", "(-1, 0.5)", "infinite"]),
        ("material.poisson_ratio=soft", &["material.poisson_ratio", "soft", "number in (-1, 0.5)"]),
        ("material.shear_modulus_pa=-1678", &["material.shear_modulus_pa", "-1678", "(0, "]),
        ("discretisation.spacing_m=0", &["discretisation.spacing_m", "0", "(0, "]),
        ("discretisation.spacing_m=-0.001", &["discretisation.spacing_m", "-0.001", "(0, "]),
        ("discretisation.spacing_m=1e-7", &["discretisation.spacing_m", "1e-7", "nodes", "GB", "at least"]),
        ("discretisation.method=fem", &["discretisation.method", "fem", "mmls, mls, tet4"]),
        ("instrument.capture_radius_m=0.001", &["instrument.capture_radius_m", "0.001", "indenter", "needle"]),
        ("motion.depth_m", &["motion.depth_m", "key=value"]),
        ("=3", &["=3", "key=value"]),
    ] {
        let message = refused(&["solve", "--scene", "indentation", "--set", setting]);
        assert_names(&message, parts);
    }
}

#[test]
fn depth_speed_and_rate_that_mean_nothing() {
    for (option, value, parts) in [
        ("--depth-m", "-0.004", &["--depth-m", "-0.004", "[0, "] as &[&str]),
        ("--depth-m", "nan", &["--depth-m", "nan", "[0, "]),
        ("--depth-m", "NaN", &["--depth-m", "nan", "[0, "]),
        ("--depth-m", "inf", &["--depth-m", "inf"]),
        ("--depth-m", "deep", &["--depth-m", "deep", "number"]),
        ("--depth-m", "0.017", &["--depth-m", "0.017", "sample.height_m"]),
        ("--speed-m-per-s", "0", &["--speed-m-per-s", "0", "(0, "]),
        ("--speed-m-per-s", "1e-9", &["--speed-m-per-s", "1e-9", "poses"]),
        ("--pose-hz", "-1000", &["--pose-hz", "-1000", "(0, "]),
    ] {
        assert_names(&refused(&["solve", "--scene", "indentation", option, value]), parts);
    }
}

#[test]
fn usage_that_is_wrong_ends_with_2() {
    for (arguments, parts) in [
        (&["frobnicate"] as &[&str], &["frobnicate"] as &[&str]),
        (&["sovle"], &["sovle", "solve"]),
        (&["solve"], &["--scene"]),
        (&["solve", "--scene", "indentation", "--threads", "0"], &["--threads", "0", "1..=1024"]),
        (&["solve", "--scene", "indentation", "--threads", "many"], &["--threads", "many"]),
        (&["solve", "--scene", "indentation", "--deth-m", "1"], &["--deth-m", "--depth-m"]),
        (&["scene", "show"], &["NAME|FILE"]),
        (&["scene", "check"], &["NAME|FILE"]),
    ] {
        assert_names(&refused(arguments), parts);
        needle_twin().args(arguments).assert().code(2);
    }
}

#[test]
fn scene_files_that_are_none() {
    assert_names(&refused(&["solve", "--scene", "indentatoin"]), &["indentatoin", "did you mean indentation?"]);
    assert_names(
        &refused(&["solve", "--scene", "no/such/file.toml"]),
        &["no/such/file.toml", "no such", "compression"],
    );
    let (_folder, path) = file("prose.toml", b"Dear twin,\nplease push the needle in.\n");
    assert_names(&refused(&["solve", "--scene", &path]), &["prose.toml:1:", "not TOML", "Dear twin"]);
    let (_folder, path) = file("bytes.toml", &[0xff, 0xfe, 0x00, 0x01]);
    assert_names(&refused(&["solve", "--scene", &path]), &["bytes.toml", "not TOML"]);
    let (folder, _) = file("any", b"");
    assert_names(&refused(&["scene", "show", folder.path().to_str().unwrap()]), &["folder"]);
    let (_folder, path) = file("long.toml", &vec![b'#'; (1 << 20) + 1]);
    assert_names(&refused(&["scene", "check", &path]), &["long.toml", "longer"]);
    let (_folder, path) = file("empty.toml", b"");
    assert_names(&refused(&["scene", "check", &path]), &["empty.toml", "sample.height_m", "missing"]);
}

#[test]
fn what_is_wrong_in_a_file_is_named_with_its_line() {
    let preset = |edit: fn(String) -> String| {
        let shown = needle_twin().args(["scene", "show", "indentation"]).output().unwrap();
        edit(String::from_utf8(shown.stdout).unwrap())
    };
    let line_of = |text: &str, needle: &str| text.lines().position(|line| line.contains(needle)).unwrap() + 1;
    for (edit, culprit, parts) in [
        (
            (|t| t.replace("poisson_ratio = 0.49", "poisson_ratio = 0.5")) as fn(String) -> String,
            "poisson_ratio",
            &["material.poisson_ratio", "0.5", "(-1, 0.5)"] as &[&str],
        ),
        (|t| t.replace("pose_hz =", "psoe_hz ="), "psoe_hz", &["motion.psoe_hz", "motion.pose_hz", "(0, "]),
        (|t| t.replace("1678.0", "\"1678\""), "\"1678\"", &["material.shear_modulus_pa", "text", "number in (0, "]),
        (
            |t| t.replace("depth_m = 0.010", "depth_m = 0.020"),
            "depth_m",
            &["motion.depth_m", "0.02", "sample.height_m"],
        ),
    ] {
        let text = preset(edit);
        let (_folder, path) = file("mine.toml", text.as_bytes());
        let message = refused(&["solve", "--scene", &path]);
        assert_names(&message, parts);
        assert_names(&message, &[&format!("mine.toml:{}", line_of(&text, culprit))]);
    }
}

#[test]
fn output_folders_that_cannot_be_written() {
    let (_folder, path) = file("in_the_way", b"kept");
    let below = Path::new(&path).join("out");
    let message = refused(&["solve", "--scene", "indentation", "--out", below.to_str().unwrap()]);
    assert_names(&message, &["in_the_way", "--out"]);
    let message = refused(&["solve", "--scene", "indentation", "--out", &path]);
    assert_names(&message, &["in_the_way"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"kept");
}

#[test]
fn one_bad_scene_among_several_is_named() {
    let (_folder, path) = file("bad.toml", b"name = 3\n");
    let output = needle_twin().args(["scene", "check", "indentation", &path]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stdout).unwrap().contains("indentation: ok"));
    assert_names(&String::from_utf8(output.stderr).unwrap(), &["bad.toml:1", "name = 3", "text"]);
}

#[test]
fn bags_that_are_none() {
    assert_names(&refused(&["replay", "no/such/bag"]), &["no/such/bag"]);
    let noise: Vec<u8> = (0..4096u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let (_folder, path) = file("noise.mcap", &noise);
    assert_names(&refused(&["replay", &path]), &["noise.mcap"]);
    let (_folder, path) = file("empty.mcap", b"");
    assert_names(&refused(&["replay", &path]), &["empty.mcap"]);
    let (folder, _) = file("any.txt", b"nothing of a bag");
    assert_names(&refused(&["replay", folder.path().to_str().unwrap()]), &[folder.path().to_str().unwrap()]);
    refused(&["replay"]);
}

#[test]
fn bags_without_what_is_needed_say_what_they_have() {
    let folder = TempDir::new().unwrap();
    let bag = RigBag { depth_topic: None, ..RigBag::default() }.write(folder.path(), "forces_only");
    let bag = bag.to_str().unwrap();
    let message = refused(&["replay", bag]);
    assert_names(
        &message,
        &["forces_only", "measured_js", "measured_cp", "/measured_cf", "geometry_msgs/msg/WrenchStamped"],
    );
    let bag = RigBag::default().write(folder.path(), "rig");
    let bag = bag.to_str().unwrap();
    assert_names(&refused(&["replay", bag, "--measured-js", "/lvdt"]), &["/lvdt", "/measured_js"]);
    assert_names(&refused(&["replay", bag, "--scene", "nonsense"]), &["nonsense", "needle_insertion"]);
    assert_names(&refused(&["replay", bag, "--set", "nonsense=1"]), &["nonsense"]);
    assert_names(&refused(&["replay", bag, "--out", "/dev/null/out"]), &["/dev/null/out"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_as_a_scene_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let (_folder, path) = file("random.toml", &bytes);
        refused(&["scene", "check", &path]);
    }
}
