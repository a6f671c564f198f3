//! A message of any type as the bytes that a bag holds.

use std::fmt;

use serde::de::{Deserialize, Deserializer, SeqAccess, Visitor};
use serde::ser::{Serialize, SerializeTuple, Serializer};

/// CDR without its encapsulation header; it is written to the wire as it is, as little-endian. What was read may be
/// big-endian.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawCdr {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl ros2_client::Message for RawCdr {}

impl RawCdr {
    /// Takes bytes without an encapsulation header.
    #[must_use]
    pub(crate) const fn new(bytes: Vec<u8>) -> Self {
        Self { bytes, big_endian: false }
    }

    /// Whether the numbers in the bytes are big-endian.
    #[must_use]
    pub(crate) const fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    /// The bytes, without an encapsulation header.
    #[must_use]
    pub(crate) fn as_slice(&self) -> &[u8] {
        &self.bytes
    }

    /// Takes a message as a bag stores it.
    ///
    /// # Errors
    /// The first bytes, if they are not those of plain little-endian CDR.
    pub fn from_bag(mut bytes: Vec<u8>) -> Result<Self, String> {
        match bytes.get(..2) {
            Some([0, 1]) if bytes.len() >= 4 => {
                bytes.drain(..4);
                Ok(Self::new(bytes))
            }
            _ => Err(format!("{:02x?}", &bytes[..bytes.len().min(4)])),
        }
    }
}

impl Serialize for RawCdr {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // A tuple of octets has neither length nor padding in CDR.
        let mut tuple = serializer.serialize_tuple(self.bytes.len())?;
        for byte in &self.bytes {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

impl<'de> Deserialize<'de> for RawCdr {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Octets;
        impl<'de> Visitor<'de> for Octets {
            type Value = RawCdr;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("octets")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut octets: A) -> Result<RawCdr, A::Error> {
                let mut bytes = Vec::new();
                // How many there are is said nowhere: the end of the input is the end of the message.
                while let Ok(Some(byte)) = octets.next_element::<u8>() {
                    bytes.push(byte);
                }
                Ok(RawCdr::new(bytes))
            }
        }
        // serde has no word for the order of bytes: the deserializer's name is the only place where it stands.
        let big_endian = std::any::type_name::<D>().contains("BigEndian");
        let raw = deserializer.deserialize_tuple(usize::MAX, Octets)?;
        Ok(Self { big_endian, ..raw })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ros2_messages::sensor_msgs::JointState;
    use ros2_messages::to_cdr;

    #[test]
    fn bytes_go_out_as_they_are() {
        let message = JointState { name: vec!["insertion".into()], position: vec![0.001], ..JointState::default() };
        let bytes = to_cdr(&message).unwrap();
        assert_eq!(to_cdr(&RawCdr::from_bag(bytes.clone()).unwrap()).unwrap(), bytes);
        assert!(RawCdr::from_bag(vec![0, 0, 0, 0, 1]).is_err(), "big endian");
        assert!(RawCdr::from_bag(vec![0]).is_err());
    }

    #[test]
    fn bytes_come_in_as_they_are() {
        let bytes: Vec<u8> = (0..=255).collect();
        let (raw, used) = cdr_encoding::from_bytes::<RawCdr, byteorder::LittleEndian>(&bytes).unwrap();
        assert_eq!((raw.as_slice(), raw.is_big_endian(), used), (&bytes[..], false, 256));
        let (raw, _) = cdr_encoding::from_bytes::<RawCdr, byteorder::BigEndian>(&bytes).unwrap();
        assert!(raw.is_big_endian());
    }
}
