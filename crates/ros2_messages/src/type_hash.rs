//! Hashes of types (RIHS01, REP-2016), by which middlewares of Jazzy and later tell apart definitions of one name.
//!
//! Messages that are recorded have theirs beside their [`schema`](mod@crate::schema). Here are the others, as rosidl of Jazzy made them
//! and, for `rosbag2_interfaces` and `needle_twin`, as an independent implementation computes them from the definitions.
//! `tests/zenoh/wire.rs` compares every one of them with such a computation.

use crate::schema::schema;

/// `package/msg/Type` or `package/srv/Type`, and the hash.
const HASHES: [(&str, &str); 28] = [
    ("lifecycle_msgs/msg/TransitionEvent", "RIHS01_d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38"),
    ("rcl_interfaces/msg/Log", "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac"),
    ("rcl_interfaces/msg/ParameterEvent", "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204"),
    ("lifecycle_msgs/srv/ChangeState", "RIHS01_356fe34f0475a43acf54542013af4167b0e729f77ea22ffb045c6ad8e20668e5"),
    (
        "lifecycle_msgs/srv/GetAvailableStates",
        "RIHS01_00a07d79d2207d71e81a8cbc1880e5d924cc16d4688ea8e8e06e443dc8f8aa1d",
    ),
    (
        "lifecycle_msgs/srv/GetAvailableTransitions",
        "RIHS01_59b7ecefce0982a8a844b9f2c4f14764c1c4543cc55e72924e2aa4adad83e9bc",
    ),
    ("lifecycle_msgs/srv/GetState", "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795"),
    ("needle_twin/srv/LookAhead", "RIHS01_99a4a04d14af7da5a4f24abab02066a951077f6ff301e644360e7b7e48c965d0"),
    (
        "rcl_interfaces/srv/DescribeParameters",
        "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    ),
    ("rcl_interfaces/srv/GetLoggerLevels", "RIHS01_03bf1bebd0d6514c7ed0ba7c5e08dc9f2f39c759fe99e1e30ea4157d7674f72d"),
    ("rcl_interfaces/srv/GetParameterTypes", "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca"),
    ("rcl_interfaces/srv/GetParameters", "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
    ("rcl_interfaces/srv/ListParameters", "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"),
    ("rcl_interfaces/srv/SetLoggerLevels", "RIHS01_3ff86cb4e91fbf9abae15c234ecc874448de6ece8e193401c077cf116e4f6d78"),
    ("rcl_interfaces/srv/SetParameters", "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
    (
        "rcl_interfaces/srv/SetParametersAtomically",
        "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    ),
    ("rosbag2_interfaces/srv/Burst", "RIHS01_3cba361b055bbec262593fcb727aeb9fb6d096f70b50e6cd9b548b63296f2380"),
    ("rosbag2_interfaces/srv/GetRate", "RIHS01_c4f24894657b45b0cca8c720ce039924cfa1a5b8baa7d1ffd94881812d8700eb"),
    ("rosbag2_interfaces/srv/IsPaused", "RIHS01_c4d007c4a9ca1a76729d96b81c20db85b88b454eee371c0d8afe3aa31b899a40"),
    ("rosbag2_interfaces/srv/Pause", "RIHS01_b101e6aaf344c37f1405f5a1f484fee1c7d2acc61c6f04aeb636e9ab3f51a497"),
    ("rosbag2_interfaces/srv/Play", "RIHS01_e87b287e52219f5f32127c876a0688c537b8a5762612f33b8e740c3b89d19d2b"),
    ("rosbag2_interfaces/srv/PlayNext", "RIHS01_2b397d59555ce383e6af4b4e43142934ad4b208bd7da01409d472f1fa481d45b"),
    ("rosbag2_interfaces/srv/Resume", "RIHS01_fb4a116a8bdfc09c4c9f48df3b295d1f546053b4bb145bcbd4c92e7eef9896b8"),
    ("rosbag2_interfaces/srv/Seek", "RIHS01_6e9b6b38c44f111e36e43903da565fb2775ab0f0e69c02169a5fb0f130b23eb4"),
    ("rosbag2_interfaces/srv/SetRate", "RIHS01_571e1d5335cc99a8e4132c46e4ea9bf873e85c39f23d375146cb7d249d939629"),
    ("rosbag2_interfaces/srv/Stop", "RIHS01_668ca94eac65895275ec6d59de0206e522deebe199d9978ffc5ddbaa84a3401e"),
    ("rosbag2_interfaces/srv/TogglePaused", "RIHS01_c4382ba5856616caf3fb7b3ecffd0eb244015814861263ccc8241b2f6c9463ae"),
    ("std_srvs/srv/Trigger", "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"),
];

/// The hash of a message or service that this program knows, by `package/msg/Type` or `package/srv/Type`.
#[must_use]
pub fn type_hash(name: &str) -> Option<String> {
    let listed = HASHES.iter().find(|(of, _)| *of == name).map(|(_, hash)| (*hash).to_owned());
    listed.or_else(|| schema(name).map(|schema| schema.hash).filter(|hash| !hash.is_empty()))
}

/// Types that [`type_hash`] knows and that have no schema.
pub fn hashed_types() -> impl Iterator<Item = (&'static str, &'static str)> {
    HASHES.iter().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_and_services_have_hashes_and_strangers_none() {
        let prefix = |name: &str| type_hash(name).map(|hash| hash[..11].to_owned());
        assert_eq!(prefix("std_msgs/msg/Float64").as_deref(), Some("RIHS01_705b"));
        assert_eq!(prefix("std_srvs/srv/Trigger").as_deref(), Some("RIHS01_eeff"));
        assert_eq!(prefix("my_msgs/msg/Other"), None);
        assert_eq!(prefix("std_msgs/msg/Header"), None, "never sent on its own");
    }
}
