//! Addresses: redirects, loopback addresses, and their display.

/// The target of a redirect, absolute or relative (RFC 3986, section 5, without dot segments); an error names a refused target. From https
/// to http is refused: any intermediary could then substitute another file.
pub(crate) fn follow(base: &str, location: &str) -> Result<String, String> {
    let (scheme, rest) = base
        .split_once("://")
        .ok_or_else(|| format!("an address without a scheme ({})", shown(base)))?;
    let host_end = rest.find(['/', '?', '#']).unwrap_or(rest.len());
    let host = &rest[..host_end];
    let path_end = rest.find(['?', '#']).unwrap_or(rest.len());
    let location = location.split('#').next().unwrap_or_default();
    let target = if location.is_empty() {
        return Err("a redirect to no address".to_owned());
    } else if has_scheme(location) {
        location.to_owned()
    } else if let Some(other) = location.strip_prefix("//") {
        format!("{scheme}://{other}")
    } else if location.starts_with('/') {
        format!("{scheme}://{host}{location}")
    } else if location.starts_with('?') {
        format!("{scheme}://{}{location}", &rest[..path_end])
    } else {
        let folder = rest[..path_end]
            .rfind('/')
            .map_or(format!("{host}/"), |slash| rest[..=slash].to_owned());
        format!("{scheme}://{folder}{location}")
    };
    let to = target
        .split_once("://")
        .map(|(s, _)| s.to_ascii_lowercase());
    match (scheme.to_ascii_lowercase().as_str(), to.as_deref()) {
        (_, Some("https")) | ("http", Some("http")) => Ok(target),
        (_, Some("http")) => Err(format!("one to {}, without encryption", shown(&target))),
        _ => Err(format!("one to {}", shown(&target))),
    }
}

/// Whether the text begins with a scheme and a colon (RFC 3986, section 3.1).
fn has_scheme(location: &str) -> bool {
    location.split_once(':').is_some_and(|(scheme, _)| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
    })
}

pub(crate) fn is_loopback(url: &str) -> bool {
    let host = url.split_once("://").map_or("", |(_, rest)| rest);
    let host = host.split(['/', '?', '#']).next().unwrap_or_default();
    let host = host.rsplit_once('@').map_or(host, |(_, h)| h);
    let host = match host.strip_prefix('[') {
        Some(six) => six.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    host.eq_ignore_ascii_case("localhost")
        || host
            .parse::<std::net::IpAddr>()
            .is_ok_and(|address| address.is_loopback())
}

/// An address for messages: without its query, which may be long and contain a signature, and without a password.
#[must_use]
pub fn shown(url: &str) -> String {
    const LONGEST: usize = 300;
    let url = url.split(['?', '#']).next().unwrap_or_default();
    let url = match url.split_once("://") {
        Some((scheme, rest)) => {
            let end = rest.find('/').unwrap_or(rest.len());
            let host = rest[..end].rfind('@').map_or(0, |at| at + 1);
            format!("{scheme}://{}", &rest[host..])
        }
        None => url.to_owned(),
    };
    url.chars()
        .take(LONGEST)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn redirect_targets_are_resolved() {
        for (base, location, target) in [
            ("https://a/b/c?d", "https://x/y", "https://x/y"),
            ("http://a/b/c", "https://x/y?z=1#f", "https://x/y?z=1"),
            ("http://a:8/b/c", "http://x", "http://x"),
            ("https://a:8/b/c?d", "/e", "https://a:8/e"),
            ("https://a/b/c?d=/", "e/f", "https://a/b/e/f"),
            ("https://a", "e", "https://a/e"),
            ("https://a?x", "/e", "https://a/e"),
            ("https://a/b?x", "?y", "https://a/b?y"),
            ("https://a/b", "//x/y", "https://x/y"),
            ("https://a/b", "/c?at=12:30", "https://a/c?at=12:30"),
        ] {
            assert_eq!(follow(base, location).unwrap(), target, "{base} {location}");
        }
        for (base, location) in [
            ("https://a/b", "http://a/b"),
            ("https://a/b", "HTTP://a/b"),
            ("http://a/b", "file:///etc/passwd"),
            ("http://a/b", "ftp://a/b"),
            ("http://a/b", "javascript:1"),
            ("http://a/b", ""),
            ("http://a/b", "#top"),
        ] {
            assert!(follow(base, location).is_err(), "{base} {location}");
        }
    }

    #[test]
    fn loopback_bypasses_proxies() {
        for url in [
            "http://127.0.0.1:80/x",
            "http://localhost/",
            "http://[::1]:8/",
            "http://a@127.1.2.3",
        ] {
            assert!(is_loopback(url), "{url}");
        }
        for url in [
            "https://github.com/127.0.0.1",
            "http://localhost.example",
            "x",
            "http://127.0.0.1@example.com/",
        ] {
            assert!(!is_loopback(url), "{url}");
        }
    }

    #[test]
    fn addresses_are_shown_without_secrets() {
        assert_eq!(
            shown("https://ada:secret@host/file?sig=secret#x"),
            "https://host/file"
        );
        assert_eq!(shown("https://host/a@b"), "https://host/a@b");
    }
}
