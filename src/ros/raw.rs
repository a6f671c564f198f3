//! A message of any type as the bytes that a bag holds.

use serde::ser::{Serialize, SerializeTuple, Serializer};

/// Little-endian CDR without its encapsulation header; it is written to the wire as it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawCdr(Vec<u8>);

impl RawCdr {
    /// Takes a message as a bag stores it.
    ///
    /// # Errors
    /// The first bytes, if they are not those of plain little-endian CDR.
    pub fn from_bag(mut bytes: Vec<u8>) -> Result<Self, String> {
        match bytes.get(..2) {
            Some([0, 1]) if bytes.len() >= 4 => {
                bytes.drain(..4);
                Ok(Self(bytes))
            }
            _ => Err(format!("{:02x?}", &bytes[..bytes.len().min(4)])),
        }
    }
}

impl Serialize for RawCdr {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // A tuple of octets has neither length nor padding in CDR.
        let mut tuple = serializer.serialize_tuple(self.0.len())?;
        for byte in &self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::ros::messages::sensor_msgs::JointState;
    use crate::ros::messages::to_cdr;

    #[test]
    fn bytes_go_out_as_they_are() {
        let message = JointState { name: vec!["insertion".into()], position: vec![0.001], ..JointState::default() };
        let bytes = to_cdr(&message).unwrap();
        assert_eq!(to_cdr(&RawCdr::from_bag(bytes.clone()).unwrap()).unwrap(), bytes);
        assert!(RawCdr::from_bag(vec![0, 0, 0, 0, 1]).is_err(), "big endian");
        assert!(RawCdr::from_bag(vec![0]).is_err());
    }
}
