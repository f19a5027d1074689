//! Decides which web pages may connect, because a browser lets a page of any origin try to connect.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// True if a page from `origin` may connect to this server; `host` is the Host header of its request.
///
/// For the served page both contain the same host. An attacker can let a name of their own resolve to this computer (DNS
/// rebinding), so the host must be an address or `localhost`. `others` are further origins that may connect. Programs other than
/// browsers send no origin, and may connect.
pub(crate) fn is_allowed(origins: &[&str], host: Option<&str>, others: &[String]) -> bool {
    let &[origin] = origins else { return origins.is_empty() };
    if others.iter().any(|other| other.trim_end_matches('/') == origin) {
        return true;
    }
    let origin_host = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    origin_host.is_some() && origin_host == host && host.is_some_and(is_address)
}

/// The one address of the page for the browsers of this computer, if the server listens at `address`; `None` if it does not
/// listen for them alone or for all.
pub fn canonical_address(address: SocketAddr) -> Option<SocketAddr> {
    match address.ip() {
        // Where a socket of IPv6 does not also accept connections of IPv4, only the address of IPv6 leads to it.
        IpAddr::V4(ip) if ip.is_unspecified() => Some(SocketAddr::new(Ipv4Addr::LOCALHOST.into(), address.port())),
        IpAddr::V6(ip) if ip.is_unspecified() => Some(SocketAddr::new(Ipv6Addr::LOCALHOST.into(), address.port())),
        ip => ip.is_loopback().then_some(address),
    }
}

/// True if the Host header of a request names this computer otherwise than its `canonical` address does. With another port, the
/// request has come through a tunnel, and the address would lead elsewhere.
pub(crate) fn is_other_name(host: &str, canonical: SocketAddr) -> bool {
    let names = ["localhost", "127.0.0.1", "[::1]"];
    host != canonical.to_string() && names.iter().any(|name| host == format!("{name}:{}", canonical.port()))
}

/// True for `localhost` or an IP address, with or without a port.
fn is_address(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    name == "localhost" || name.trim_matches(['[', ']']).parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::{canonical_address, is_allowed, is_other_name};
    use std::net::SocketAddr;

    #[test]
    fn this_computer_has_one_address() {
        let address = |text: &str| text.parse::<SocketAddr>().expect("an address");
        for listening in ["127.0.0.1:7340", "0.0.0.0:7340"] {
            let canonical = canonical_address(address(listening)).expect("a server of this computer");
            assert_eq!(canonical, address("127.0.0.1:7340"));
            assert!(is_other_name("localhost:7340", canonical) && is_other_name("[::1]:7340", canonical));
            for host in [
                "127.0.0.1:7340",
                "localhost:8000",
                "192.168.1.20:7340",
                "insoles.example",
                "localhost.evil.example:7340",
            ] {
                assert!(!is_other_name(host, canonical), "{host}");
            }
        }
        for listening in ["[::1]:7340", "[::]:7340"] {
            let canonical = canonical_address(address(listening)).expect("a server of this computer");
            assert_eq!(canonical, address("[::1]:7340"));
            assert!(is_other_name("localhost:7340", canonical) && !is_other_name("[::1]:7340", canonical));
        }
        assert_eq!(canonical_address(address("192.168.1.20:7340")), None);
    }

    #[test]
    fn the_served_page_and_allowed_origins_may_connect() {
        let others = ["https://insoles.example".to_string()];
        for host in ["127.0.0.1:7340", "localhost:7340", "[::1]:7340", "192.168.1.20:7340"] {
            assert!(is_allowed(&[&format!("http://{host}")], Some(host), &others), "{host}");
        }
        assert!(is_allowed(&["https://insoles.example"], Some("127.0.0.1:7340"), &others));
        assert!(is_allowed(&[], Some("127.0.0.1:7340"), &others));
    }

    #[test]
    fn pages_from_other_origins_may_not_connect() {
        for (origin, host) in [
            ("https://evil.example", "127.0.0.1:7340"),
            ("http://localhost:8080", "localhost:7340"),
            // A name that resolves to this computer.
            ("http://evil.example:7340", "evil.example:7340"),
            ("null", "127.0.0.1:7340"),
            // A header that is not text; `web.rs` replaces it by an empty text.
            ("", "127.0.0.1:7340"),
        ] {
            assert!(!is_allowed(&[origin], Some(host), &[]), "{origin}");
        }
        assert!(!is_allowed(&["http://localhost:7340"; 2], Some("localhost:7340"), &[]), "a browser sends one origin");
    }
}
