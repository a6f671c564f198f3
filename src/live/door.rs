//! Access control. A request from another site's page is rejected, and commands need the token.
//!
//! Any web page that is open on this machine can make its browser send requests to a port of the loopback. The
//! browser states the page's site (`Origin`) and the requested host name (`Host`). If an attacker has pointed a host
//! name at 127.0.0.1 (DNS rebinding), `Host` has that name.

use std::net::{IpAddr, SocketAddr};

use axum::http::{HeaderMap, HeaderName, header, uri::Authority};

/// Bytes of a token: 128 bits.
const BYTES: usize = 16;

/// See the module.
#[derive(Debug)]
pub(super) struct Door {
    served: SocketAddr,
    token: String,
}

impl Door {
    /// Creates a new token.
    pub(crate) fn new(served: SocketAddr) -> Self {
        let bytes: [u8; BYTES] = rand::random();
        Self { served, token: bytes.iter().map(|b| format!("{b:02x}")).collect() }
    }

    /// The token, which the node prints.
    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Compares in constant time.
    pub(crate) fn is_token(&self, given: &str) -> bool {
        let differ = self.token.bytes().zip(given.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        given.len() == self.token.len() && differ == 0
    }

    /// Whether a request may be answered.
    ///
    /// # Errors
    /// The reason of the rejection, for the client.
    pub(crate) fn admits(&self, headers: &HeaderMap) -> Result<(), &'static str> {
        let host = only(headers, header::HOST).ok_or("one Host is needed")?;
        if !self.is_served(host) {
            return Err("this Host is not served here: use the address that the node prints");
        }
        let same = |origin: &str| origin.strip_prefix("http://").is_some_and(|from| from.eq_ignore_ascii_case(host));
        match only(headers, header::ORIGIN) {
            Some(origin) if same(origin) => Ok(()),
            None if !headers.contains_key(header::ORIGIN) => Ok(()),
            _ => Err("pages of other sites get nothing from here"),
        }
    }

    /// Whether the host is the served address. If all addresses are served, any numeric address is accepted: only
    /// names can be pointed at another machine.
    fn is_served(&self, host: &str) -> bool {
        let Ok(authority) = host.parse::<Authority>() else { return false };
        let (name, served) = (authority.host(), self.served.ip());
        let anywhere = served.is_unspecified();
        let place = match name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            Ok(ip) => anywhere || ip == served || (ip.is_loopback() && served.is_loopback()),
            Err(_) => name.eq_ignore_ascii_case("localhost") && (anywhere || served.is_loopback()),
        };
        place && !host.contains('@') && authority.port_u16().unwrap_or(80) == self.served.port()
    }
}

/// The value of a header that occurs exactly once.
fn only(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    values.next().filter(|_| values.next().is_none())?.to_str().ok()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn door(address: &str) -> Door {
        Door::new(address.parse().unwrap())
    }

    fn admits(door: &Door, host: &str, origin: Option<&str>) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().unwrap());
        origin.map(|o| headers.insert(header::ORIGIN, o.parse().unwrap()));
        door.admits(&headers).is_ok()
    }

    #[test]
    fn only_the_address_that_is_served() {
        let local = door("127.0.0.1:8080");
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"] {
            assert!(admits(&local, host, None), "{host}");
            assert!(admits(&local, host, Some(&format!("http://{host}"))), "{host}");
        }
        for host in [
            "evil.test:8080",
            "127.0.0.1:8081",
            "127.0.0.1",
            "localhost.evil.test:8080",
            "10.0.0.1:8080",
            "",
            "a@b:8080",
        ] {
            assert!(!admits(&local, host, None), "{host}");
        }
        for origin in [
            "http://evil.test:8080",
            "null",
            "https://127.0.0.1:8080",
            "http://127.0.0.1:80",
            "http://localhost:8080",
            "",
        ] {
            assert!(!admits(&local, "127.0.0.1:8080", Some(origin)), "{origin}");
        }
        assert!(local.admits(&HeaderMap::new()).is_err(), "no host");
        let card = door("192.168.1.5:80");
        assert!(admits(&card, "192.168.1.5", None) && !admits(&card, "localhost", None));
        let all = door("0.0.0.0:8080");
        assert!(admits(&all, "192.168.1.5:8080", None) && !admits(&all, "evil.test:8080", None));
    }

    #[test]
    fn a_token_is_new_each_time_and_taken_whole() {
        let (one, other) = (door("127.0.0.1:1"), door("127.0.0.1:1"));
        assert!(one.is_token(one.token()) && !one.is_token(other.token()));
        assert!(one.token().len() == 32 && !one.is_token("") && !one.is_token(&one.token()[..31]));
        assert!(!one.is_token(&format!("{}0", one.token())));
    }
}
