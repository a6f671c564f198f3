//! The configuration of a session.

use zenoh::Config;

use crate::session::ZenohSession;

/// As rmw_zenoh_cpp has it: a peer that finds others through a router on this machine and listens on the loopback only. A service may take
/// ten minutes. Two things are not Zenoh's default, 2 batches and 1 ms: on a busy machine what is reliable was dropped when the sending thread
/// did not run for some milliseconds. 16 is the most that Zenoh has; who is stuck holds others up for 50 ms once, and what follows is
/// dropped until it goes on.
const CONFIG: &str = r#"{
    mode: "peer",
    connect: { endpoints: ["tcp/localhost:7447"] },
    listen: { endpoints: ["tcp/localhost:0"] },
    scouting: { multicast: { enabled: false }, gossip: { enabled: true } },
    timestamping: { enabled: { router: true, peer: true, client: true } },
    queries_default_timeout: 600000,
    transport: { link: { tx: { queue: { size: { data: 16 }, congestion_control: { drop: { wait_before_drop: 50000 } } } } } },
}"#;

/// What an error says, without the place in Zenoh's source that it ends with.
pub(super) fn said(error: &dyn std::fmt::Display) -> String {
    let text = error.to_string();
    let place = |rest: &str| rest.contains(".rs:");
    text.rsplit_once(" at ").filter(|(_, rest)| place(rest)).map_or_else(|| text.clone(), |(what, _)| what.to_owned())
}

/// The user's configuration, or the built-in one, with what the user puts on top.
///
/// # Errors
/// What of it can't be used, and why.
pub(super) fn config(session: &ZenohSession) -> Result<Config, String> {
    let mut config = match &session.config_file {
        Some(file) => Config::from_file(file).map_err(|e| {
            format!("ZENOH_SESSION_CONFIG_URI={}: no Zenoh configuration: {}", file.display(), said(&e))
        })?,
        None => Config::from_json5(CONFIG).map_err(|e| said(&e))?,
    };
    for part in session.overrides.split(';').map(str::trim).filter(|part| !part.is_empty()) {
        let wrong = |why: &dyn std::fmt::Display| format!("ZENOH_CONFIG_OVERRIDE: `{part}`: {}", said(why));
        let (key, value) = part.split_once('=').ok_or_else(|| wrong(&"is not key=value"))?;
        config.insert_json5(key.trim(), value.trim()).map_err(|e| wrong(&e))?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn with(overrides: &str) -> Result<Config, String> {
        config(&ZenohSession { overrides: overrides.to_owned(), ..ZenohSession::default() })
    }

    #[test]
    fn overrides_are_taken_or_refused_by_name() {
        let client = with("mode=\"client\"; connect/endpoints=[\"tcp/127.0.0.1:7448\"];").unwrap();
        assert_eq!(client.get_json("mode").unwrap(), "\"client\"");
        assert!(client.get_json("connect/endpoints").unwrap().contains("7448"));
        assert!(with("").unwrap().get_json("listen/endpoints").unwrap().contains("tcp/localhost:0"));
        assert_eq!(
            with("").unwrap().get_json("transport/link/tx/queue/size/data_high").unwrap(),
            "2",
            "the rest is Zenoh's"
        );
        for wrong in ["mode", "mode=\"king\"", "no/such/key=1"] {
            let error = with(wrong).unwrap_err();
            assert!(
                error.contains(wrong) && error.contains("ZENOH_CONFIG_OVERRIDE") && !error.contains(".rs"),
                "{error}"
            );
        }
        let missing = ZenohSession { config_file: Some("/no/such/file.json5".into()), ..ZenohSession::default() };
        assert!(config(&missing).is_err_and(|e| e.contains("/no/such/file.json5")));
    }
}
