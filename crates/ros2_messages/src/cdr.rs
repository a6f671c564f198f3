//! Common Data Representation: the 4-byte encapsulation header and what follows it.

use byteorder::{BigEndian, LittleEndian};
use serde::{Serialize, de::DeserializeOwned};

/// Encapsulation header of plain little-endian CDR (`CDR_LE`, no options): what ROS 2 writes on every common machine.
const LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

/// Why bytes are not the message that they should be, or a message can't be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// Fewer than four bytes, or an encapsulation that ROS 2 does not use.
    #[error("not plain CDR: it starts with {start:02x?} (expected 00 00 or 00 01, then two bytes of options)")]
    Encapsulation {
        /// The first bytes, at most four.
        start: Vec<u8>,
    },
    /// The bytes end too early, or hold a value that the type can't have.
    #[error("{bytes} bytes of CDR don't hold this message: {reason}")]
    Content {
        /// Length with the encapsulation header.
        bytes: usize,
        /// What the decoder said.
        reason: String,
    },
    /// The message can't be written as CDR.
    #[error("the message can't be written as CDR: {reason}")]
    Write {
        /// What the encoder said.
        reason: String,
    },
}

/// A message as a bag stores it: encapsulation header and little-endian CDR.
///
/// # Errors
/// [`CdrError::Write`] for what CDR can't hold (a sequence of unknown length); none of this crate's messages.
pub fn to_cdr<T: Serialize>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut bytes = Vec::new();
    to_cdr_in(&mut bytes, message)?;
    Ok(bytes)
}

/// As [`to_cdr`], into memory that is used again: whatever `bytes` held is replaced.
///
/// # Errors
/// As [`to_cdr`].
pub fn to_cdr_in<T: Serialize>(bytes: &mut Vec<u8>, message: &T) -> Result<(), CdrError> {
    bytes.clear();
    bytes.extend_from_slice(&LITTLE_ENDIAN);
    // Alignment counts from behind the header: the encoder has its own count, which starts at 0 here.
    cdr_encoding::to_writer::<T, LittleEndian, &mut Vec<u8>>(bytes, message)
        .map_err(|e| CdrError::Write { reason: e.to_string() })
}

/// The message in `bytes`, little or big endian as its encapsulation header says. Bytes behind it are ignored, as
/// ROS 2 does (middleware pads to a multiple of four).
///
/// Memory stays within a small multiple of `bytes.len()`: a length that the bytes declare is never trusted.
///
/// # Errors
/// [`CdrError::Encapsulation`] or [`CdrError::Content`] if the bytes are something else.
pub fn from_cdr<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    let wrong_start = || CdrError::Encapsulation { start: bytes[..bytes.len().min(4)].to_vec() };
    let (header, body) = bytes.split_at_checked(4).ok_or_else(wrong_start)?;
    let decoded = match header[..2] {
        [0, 1] => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        [0, 0] => cdr_encoding::from_bytes::<T, BigEndian>(body),
        _ => return Err(wrong_start()),
    };
    decoded.map(|(message, _used)| message).map_err(|e| CdrError::Content { bytes: bytes.len(), reason: e.to_string() })
}

/// `uint8[]` as one block: `#[serde(with = "octets")]` on a `Vec<u8>`. The bytes on the wire are those of a sequence
/// of octets; writing and reading them one by one costs milliseconds for a cloud.
pub(crate) mod octets {
    use serde::{Deserializer, Serializer, de};

    pub(crate) fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytes)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        struct Octets;
        impl de::Visitor<'_> for Octets {
            type Value = Vec<u8>;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a sequence of octets")
            }
            fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<Vec<u8>, E> {
                Ok(bytes)
            }
            fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<Vec<u8>, E> {
                Ok(bytes.to_vec())
            }
        }
        deserializer.deserialize_byte_buf(Octets)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::std_msgs::{Float64, Header};

    #[test]
    fn header_and_alignment_are_those_of_the_standard() {
        let bytes = to_cdr(&Float64 { data: 1.0 }).unwrap();
        assert_eq!(bytes, [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]);
        assert_eq!(from_cdr::<Float64>(&[0, 0, 0, 0, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0]).unwrap().data, 1.0, "big endian");
    }

    #[test]
    fn short_or_foreign_bytes_are_refused() {
        assert!(matches!(from_cdr::<Float64>(&[0, 1]), Err(CdrError::Encapsulation { .. })));
        assert!(matches!(from_cdr::<Float64>(&[0, 3, 0, 0, 0, 0, 0, 0]), Err(CdrError::Encapsulation { .. })));
        assert!(matches!(from_cdr::<Float64>(&[0, 1, 0, 0, 0]), Err(CdrError::Content { .. })));
        // A string that claims 4 GB.
        let bytes = [0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, b'x'];
        assert!(matches!(from_cdr::<Header>(&bytes), Err(CdrError::Content { .. })));
    }
}
