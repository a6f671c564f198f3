//! Contract of `completions` and `man`: what shells and `man` read, made from the options themselves.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::process::Command;

fn needle_twin(arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(arguments).output().unwrap()
}

#[test]
fn bash_completes_what_the_program_knows() {
    let output = needle_twin(&["completions", "bash"]);
    assert!(output.status.success());
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("needle_twin");
    fs::write(&script, &output.stdout).unwrap();
    // what a shell offers after `needle_twin sc` and after `needle_twin solve --thr`
    let offered = |words: &str, index: usize| {
        let ask = format!(
            "source {}; COMP_WORDS=({words}); COMP_CWORD={index}; _needle_twin needle_twin \"${{COMP_WORDS[{index}]}}\" ''; echo \"${{COMPREPLY[@]}}\"",
            script.display()
        );
        let output = Command::new("bash").args(["-c", &ask]).output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    };
    assert_eq!(offered("needle_twin sc", 1), "scene");
    assert_eq!(offered("needle_twin solve --thr", 2), "--threads");
    assert_eq!(offered("needle_twin doc", 1), "doctor");
    for shell in ["zsh", "fish", "elvish", "powershell"] {
        assert!(needle_twin(&["completions", shell]).stdout.len() > 1000, "{shell}");
    }
    assert_eq!(needle_twin(&["completions", "dash"]).status.code(), Some(2));
}

#[test]
fn there_is_a_manual_page_for_the_program_and_each_command() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("man1");
    assert!(needle_twin(&["man", "--out", out.to_str().unwrap()]).status.success());
    let page = fs::read_to_string(out.join("needle_twin.1")).unwrap();
    assert!(page.contains(".TH needle_twin 1") && page.contains("Exit codes"), "{page}");
    let replay = fs::read_to_string(out.join("needle_twin-replay.1")).unwrap();
    assert!(replay.contains("position\\-unit"), "options are in the page of their command");
    assert!(fs::read_to_string(out.join("needle_twin-doctor.1")).unwrap().contains("bundle"));
    let hidden = fs::read_dir(&out).unwrap().any(|e| e.unwrap().file_name().to_string_lossy().contains("twin-node"));
    assert!(!hidden, "what help hides has no page");
    // a file stands where the folder should be
    let output = needle_twin(&["man", "--out", out.join("needle_twin.1").to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("--out"));
}
