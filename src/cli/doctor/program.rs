//! The program and the system under it: versions.

use std::fs;

use super::row::Row;

/// Features of the build that change what the program can do.
const FEATURES: [(&str, bool); 7] = [
    ("ros", cfg!(feature = "ros")),
    ("page", cfg!(feature = "page")),
    ("slicer", cfg!(feature = "slicer")),
    ("plots", cfg!(feature = "plots")),
    ("xlsx", cfg!(feature = "xlsx")),
    ("zenoh", cfg!(feature = "zenoh")),
    ("research", cfg!(feature = "research")),
];

pub(super) fn rows() -> Vec<Row> {
    vec![
        Row::ok("version", concat!("needle_twin ", env!("CARGO_PKG_VERSION"))),
        build(),
        system(),
        libc(),
        distribution(),
    ]
}

fn build() -> Row {
    let features: Vec<&str> = FEATURES.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect();
    let features = if features.is_empty() { "none".to_owned() } else { features.join(", ") };
    let value = format!("{} {}, {}, features: {features}", env!("BUILT_FOR"), env!("BUILT_AS"), env!("BUILT_BY"));
    if cfg!(debug_assertions) {
        Row::note(
            "build",
            value,
            "Build with `cargo build --release`: this build is for debugging and several times slower.",
        )
    } else {
        Row::ok("build", value)
    }
}

fn system() -> Row {
    let name = rustix::system::uname();
    let [kernel, release, machine] =
        [name.sysname(), name.release(), name.machine()].map(|part| part.to_string_lossy());
    let container = ["/.dockerenv", "/run/.containerenv"].iter().any(|mark| fs::exists(mark).unwrap_or(false));
    let place = if container { ", in a container" } else { "" };
    Row::ok("system", format!("{}, {kernel} {release} {machine}{place}", distribution_of_the_system()))
}

fn distribution_of_the_system() -> String {
    let text = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="));
    name.map_or_else(|| "unknown distribution".to_owned(), |name| name.trim_matches('"').to_owned())
}

/// The C library that the program runs with. The file says its version; asking the library itself would need unsafe code.
fn libc() -> Row {
    let maps = fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let file =
        maps.lines().filter_map(|line| line.find('/').map(|at| &line[at..])).find(|path| path.contains("/libc.so"));
    let Some(file) = file else { return Row::ok("C library", "linked into the program") };
    let said = fs::read(file).ok().and_then(|bytes| glibc_version(&bytes));
    Row::ok("C library", said.map_or_else(|| "not glibc".to_owned(), |version| format!("glibc {version}")))
}

/// The version in `GNU C Library (Debian GLIBC 2.36-9+deb12u13) stable release version 2.36.`
fn glibc_version(library: &[u8]) -> Option<String> {
    const MARK: &[u8] = b" release version ";
    let at = library.windows(MARK.len()).position(|window| window == MARK)? + MARK.len();
    let digits = library[at..].iter().take_while(|byte| byte.is_ascii_digit() || **byte == b'.');
    Some(String::from_utf8_lossy(&digits.copied().collect::<Vec<_>>()).trim_end_matches('.').to_owned())
}

/// ROS's own installation in the environment. None is needed.
fn distribution() -> Row {
    let of = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
    let middleware = of("RMW_IMPLEMENTATION").map(|name| format!(", {name}")).unwrap_or_default();
    match (of("ROS_VERSION").as_deref(), of("ROS_DISTRO")) {
        (Some("1"), distribution) => Row::problem(
            "ROS installation",
            format!("ROS 1 {}", distribution.unwrap_or_default()),
            "Open a shell without the setup file of ROS 1: the nodes speak ROS 2.",
        ),
        (_, Some(distribution)) => Row::ok("ROS installation", format!("{distribution}{middleware}")),
        (_, None) => Row::ok("ROS installation", format!("none in the environment{middleware}; none is needed")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_stands_in_the_library() {
        let library = b"\0GNU C Library (Debian GLIBC 2.36-9) stable release version 2.36.\nFree software";
        assert_eq!(glibc_version(library).as_deref(), Some("2.36"));
        assert_eq!(glibc_version(b"musl"), None);
    }
}
