//! Says to the program what built it, for `needle_twin doctor` and reports of faults.

use std::process::Command;

fn main() {
    // nothing else than a new compiler changes it, after which cargo runs this again
    println!("cargo:rerun-if-changed=build.rs");
    let of = |variable| std::env::var(variable).unwrap_or_default();
    let version = Command::new(of("RUSTC")).arg("--version").output();
    let rustc = version.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default();
    println!("cargo:rustc-env=BUILT_BY={rustc}");
    println!("cargo:rustc-env=BUILT_FOR={}", of("TARGET"));
    println!("cargo:rustc-env=BUILT_AS={}, opt-level {}", of("PROFILE"), of("OPT_LEVEL"));
}
