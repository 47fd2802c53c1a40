//! Whether a request is answered: to whom, and from which page.
//!
//! Any page that a browser has open may send requests to this computer, and by a name of its own that leads here (DNS
//! rebinding) read the answers. So:
//! - a request names a host that can only be this computer: an address, or `localhost`. With a token any name will do, since
//!   no other page knows it;
//! - what a page of another origin sends is refused, whether it reads or acts;
//! - where others than this computer's users can reach the port, every request brings the token.
//!
//! Errors: none. A refusal is an answer.

use std::net::IpAddr;

/// What a request says of where it comes from and where it goes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Asked<'r> {
    /// The header `Host`.
    pub(crate) host: Option<&'r str>,
    /// The header `Origin`, which browsers send with whatever a page of another origin sends.
    pub(crate) origin: Option<&'r str>,
    /// The header `Sec-Fetch-Site`, which newer ones send with everything.
    pub(crate) fetch_site: Option<&'r str>,
    /// What stands behind the `?`.
    pub(crate) query: Option<&'r str>,
    /// Whether it wants something done, and not only to read.
    pub(crate) acts: bool,
    /// Whether it is for the page itself, which a person may have followed a link to.
    pub(crate) is_page: bool,
}

/// Why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// It names no host, or one that may be another's.
    Host,
    /// A page of another origin sent it.
    Origin,
    /// It does not bring the token.
    Token,
}

impl Refusal {
    /// Why, and what to do.
    pub(crate) fn in_words(self) -> &'static str {
        match self {
            Self::Host => {
                "refused: this host name may be somebody else's; open the page as palpate printed its address, by number or as localhost\n"
            }
            Self::Origin => "refused: the request comes from a page of another origin\n",
            Self::Token => {
                "refused: the address lacks the token; open the page as palpate printed its address, with ?token=\n"
            }
        }
    }
}

/// Who is answered.
#[derive(Clone, Debug)]
pub(crate) struct Access {
    token: Option<String>,
}

impl Access {
    /// Whoever brings this token; without one whoever is on this computer.
    pub(crate) fn new(token: Option<String>) -> Self {
        Self { token }
    }

    /// Whether a request is answered.
    pub(crate) fn check(&self, asked: &Asked<'_>) -> Result<(), Refusal> {
        let host = asked.host.ok_or(Refusal::Host)?;
        if self.token.is_none() && !is_this_computer(host) {
            return Err(Refusal::Host);
        }
        if asked.origin.is_some_and(|origin| origin.strip_prefix("http://") != Some(host)) {
            return Err(Refusal::Origin);
        }
        let is_foreign = asked.fetch_site.is_some_and(|site| !["same-origin", "none"].contains(&site));
        if is_foreign && (asked.acts || !asked.is_page) {
            return Err(Refusal::Origin);
        }
        match &self.token {
            Some(token) if !token_of(asked.query).is_some_and(|told| are_equal(told, token)) => Err(Refusal::Token),
            _ => Ok(()),
        }
    }
}

/// Whether a host, with or without its port, can only be this computer.
fn is_this_computer(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']').map_or("", |(address, _)| address),
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

fn token_of(query: Option<&str>) -> Option<&str> {
    query?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

/// Whether two texts are equal, in a time that does not tell where they differ.
fn are_equal(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Asked<'_> = Asked {
        host: Some("127.0.0.1:8686"),
        origin: None,
        fetch_site: None,
        query: None,
        acts: false,
        is_page: false,
    };

    #[test]
    fn a_host_must_be_this_computer_where_there_is_no_token() {
        let open = Access::new(None);
        for host in ["127.0.0.1:8686", "localhost:9000", "LOCALHOST", "[::1]:8686", "127.3.2.1"] {
            assert_eq!(open.check(&Asked { host: Some(host), ..HERE }), Ok(()), "{host}");
        }
        for host in
            ["evil.example:8686", "localhost.evil.example", "192.168.1.4:8686", "", "[::1", "127.0.0.1.evil.example"]
        {
            assert_eq!(open.check(&Asked { host: Some(host), ..HERE }), Err(Refusal::Host), "{host}");
        }
        assert_eq!(open.check(&Asked { host: None, ..HERE }), Err(Refusal::Host));
    }

    #[test]
    fn what_a_page_of_another_origin_sends_is_refused() {
        for access in [Access::new(None), Access::new(Some("abc".to_owned()))] {
            let here = Asked { query: Some("token=abc"), ..HERE };
            for origin in ["http://evil.example", "null", "https://127.0.0.1:8686", "http://127.0.0.1:8687", ""] {
                for acts in [false, true] {
                    let asked = Asked { origin: Some(origin), acts, ..here };
                    assert_eq!(access.check(&asked), Err(Refusal::Origin), "{origin}");
                }
            }
            assert_eq!(access.check(&Asked { origin: Some("http://127.0.0.1:8686"), acts: true, ..here }), Ok(()));
            for site in ["cross-site", "same-site"] {
                assert_eq!(access.check(&Asked { fetch_site: Some(site), ..here }), Err(Refusal::Origin), "{site}");
                // A link to the page may stand anywhere.
                assert_eq!(access.check(&Asked { fetch_site: Some(site), is_page: true, ..here }), Ok(()));
            }
        }
    }

    #[test]
    fn a_token_is_needed_whole_and_makes_names_of_hosts_good() {
        let access = Access::new(Some("abc".to_owned()));
        let asked = |query| Asked { host: Some("bench.lab:8686"), query, ..HERE };
        assert_eq!(access.check(&asked(Some("token=abc"))), Ok(()));
        assert_eq!(access.check(&asked(Some("x=1&token=abc"))), Ok(()));
        for query in [
            None,
            Some(""),
            Some("token="),
            Some("token=ab"),
            Some("token=abcd"),
            Some("token=abd"),
            Some("nottoken=abc"),
        ] {
            assert_eq!(access.check(&asked(query)), Err(Refusal::Token), "{query:?}");
        }
    }
}
