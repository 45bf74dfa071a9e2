//! Who may ask: checks of `Host`, `Origin` and the token.
//!
//! A page of another site can send requests to this machine, and a name of its own can be made to point here. Neither gets
//! an answer: the `Host` must be one that the server was started for, an `Origin` must be the page's own, and what a browser
//! marks as sent from another site is refused.

use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use std::borrow::Cow;
use std::net::{IpAddr, SocketAddr};

/// The rules of one server.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    pub(crate) address: SocketAddr,
    pub(crate) token: Option<String>,
}

/// Why a request is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Refusal(pub(crate) StatusCode, pub(crate) Cow<'static, str>);

const WRONG_HOST: Refusal = Refusal(
    StatusCode::MISDIRECTED_REQUEST,
    Cow::Borrowed("This server answers to the address it was started for alone; open the address that sfg printed."),
);
const WRONG_ORIGIN: Refusal = Refusal(StatusCode::FORBIDDEN, Cow::Borrowed("Requests from pages of other sites are refused."));
const NO_TOKEN: Refusal = Refusal(
    StatusCode::UNAUTHORIZED,
    Cow::Borrowed("The token is missing or wrong; open the address with ?token=... that sfg was started with."),
);

impl Guard {
    /// Checks a request to the programming interface, the WebSocket included; `is_page` for the files of the page, which hold
    /// nothing of the run.
    pub(crate) fn check(&self, method: &Method, uri: &Uri, headers: &HeaderMap, is_page: bool) -> Result<(), Refusal> {
        let host = text(headers, &header::HOST).ok_or(WRONG_HOST)?;
        if !self.is_own(host) {
            return Err(WRONG_HOST);
        }
        if is_page && *method == Method::GET {
            return Ok(());
        }
        if headers.contains_key(header::ORIGIN) {
            let origin = text(headers, &header::ORIGIN).unwrap_or_default();
            if origin.strip_prefix("http://").is_none_or(|origin| !origin.eq_ignore_ascii_case(host)) {
                return Err(WRONG_ORIGIN);
            }
        }
        if headers.get("sec-fetch-site").is_some_and(|site| site != "same-origin" && site != "none") {
            return Err(WRONG_ORIGIN);
        }
        match &self.token {
            Some(token) if !given(uri, headers).is_some_and(|given| is_same(given.as_bytes(), token.as_bytes())) => Err(NO_TOKEN),
            _ => Ok(()),
        }
    }

    /// Whether a `Host` names this server.
    fn is_own(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.ends_with(']') => (name, port.parse::<u16>().ok()),
            _ => (host, Some(80)),
        };
        if port != Some(self.address.port()) {
            return false;
        }
        let ip = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>().ok();
        if self.address.ip().is_loopback() {
            return name.eq_ignore_ascii_case("localhost") || ip.is_some_and(|ip| ip.is_loopback());
        }
        // A name could be made to point here; a number is what the connection was made to.
        ip.is_some_and(|ip| self.address.ip().is_unspecified() || ip == self.address.ip())
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &header::HeaderName) -> Option<&'a str> {
    let mut values = headers.get_all(name).iter();
    let first = values.next()?.to_str().ok()?;
    values.next().is_none().then_some(first)
}

/// The token of a request, as `?token=` or as a bearer.
fn given(uri: &Uri, headers: &HeaderMap) -> Option<String> {
    if let Some(bearer) = text(headers, &header::AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer ")) {
        return Some(bearer.trim().to_owned());
    }
    let pairs = uri.query()?.split('&').filter_map(|pair| pair.split_once('='));
    pairs.filter(|(name, _)| *name == "token").map(|(_, value)| percent_decoded(value)).next()
}

fn percent_decoded(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let hex = after.get(..2).filter(|_| first == b'%').and_then(|hex| std::str::from_utf8(hex).ok());
        match hex.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Equality that takes the same time wherever the first difference is.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn check(guard: &Guard, uri: &str, headers: &[(&'static str, &str)], is_page: bool) -> Result<(), StatusCode> {
        let map = headers.iter().map(|(name, value)| (header::HeaderName::from_static(name), value.parse().unwrap())).collect();
        guard.check(&Method::GET, &uri.parse().unwrap(), &map, is_page).map_err(|denied| denied.0)
    }

    #[test]
    fn only_own_hosts_and_origins_are_answered() {
        let guard = Guard { address: "127.0.0.1:8787".parse().unwrap(), token: None };
        let host = ("host", "127.0.0.1:8787");
        for own in ["127.0.0.1:8787", "localhost:8787", "[::1]:8787"] {
            assert_eq!(check(&guard, "/api/runs", &[("host", own)], false), Ok(()), "{own}");
        }
        for other in ["evil.example:8787", "127.0.0.1", "127.0.0.1:8788", "127.0.0.1.evil.example:8787", "", "[::1]:1:8787"] {
            assert_eq!(check(&guard, "/", &[("host", other)], true), Err(StatusCode::MISDIRECTED_REQUEST), "{other}");
        }
        assert_eq!(check(&guard, "/", &[], true), Err(StatusCode::MISDIRECTED_REQUEST));
        assert_eq!(check(&guard, "/api/runs", &[host, ("origin", "http://127.0.0.1:8787")], false), Ok(()));
        for origin in ["http://evil.example", "https://127.0.0.1:8787", "http://127.0.0.1:8788", "null"] {
            assert_eq!(check(&guard, "/api/runs", &[host, ("origin", origin)], false), Err(StatusCode::FORBIDDEN), "{origin}");
        }
        assert_eq!(check(&guard, "/api/runs", &[host, ("sec-fetch-site", "cross-site")], false), Err(StatusCode::FORBIDDEN));
        // A link from another site opens the page.
        assert_eq!(check(&guard, "/", &[host, ("sec-fetch-site", "cross-site")], true), Ok(()));
    }

    #[test]
    fn a_token_is_asked_of_everything_but_the_page_itself() {
        let guard = Guard { address: "192.0.2.7:8787".parse().unwrap(), token: Some("a b".to_owned()) };
        let host = ("host", "192.0.2.7:8787");
        assert_eq!(check(&guard, "/", &[host], true), Ok(()));
        assert_eq!(check(&guard, "/api/runs", &[host], false), Err(StatusCode::UNAUTHORIZED));
        assert_eq!(check(&guard, "/api/runs?token=a%20c", &[host], false), Err(StatusCode::UNAUTHORIZED));
        assert_eq!(check(&guard, "/api/runs?x=1&token=a%20b", &[host], false), Ok(()));
        assert_eq!(check(&guard, "/api/runs", &[host, ("authorization", "Bearer a b")], false), Ok(()));
        assert_eq!(
            check(&guard, "/api/runs?token=a%20b", &[("host", "name.example:8787")], false),
            Err(StatusCode::MISDIRECTED_REQUEST)
        );
        // Every address of this machine: numbers only.
        let guard = Guard { address: "0.0.0.0:8787".parse().unwrap(), token: Some("t".to_owned()) };
        assert_eq!(check(&guard, "/api/runs?token=t", &[("host", "192.0.2.9:8787")], false), Ok(()));
        assert_eq!(
            check(&guard, "/api/runs?token=t", &[("host", "evil.example:8787")], false),
            Err(StatusCode::MISDIRECTED_REQUEST)
        );
    }
}
