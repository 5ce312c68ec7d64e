//! The encryption of downloads: rustls with the cryptography of Graviola, which requires features that some CPUs lack.

use ureq::tls::{RootCerts, TlsConfig};

/// Features required by the cryptography that this CPU lacks, as part of a message; `None` if there are none. Without them the cryptography
/// would panic.
pub(crate) fn missing() -> Option<String> {
    let missing: Vec<&str> = features()
        .into_iter()
        .filter_map(|(name, is_here)| (!is_here).then_some(name))
        .collect();
    (!missing.is_empty()).then(|| missing.join(", "))
}

/// As in Graviola's `is_cpu_supported`.
#[cfg(target_arch = "x86_64")]
fn features() -> Vec<(&'static str, bool)> {
    use std::arch::is_x86_feature_detected as has;
    vec![
        ("adx", has!("adx")),
        ("aes", has!("aes")),
        ("avx", has!("avx")),
        ("avx2", has!("avx2")),
        ("bmi1", has!("bmi1")),
        ("pclmulqdq", has!("pclmulqdq")),
    ]
}

/// As in Graviola's `is_cpu_supported`.
#[cfg(target_arch = "aarch64")]
fn features() -> Vec<(&'static str, bool)> {
    use std::arch::is_aarch64_feature_detected as has;
    vec![
        ("aes", has!("aes")),
        ("neon", has!("neon")),
        ("pmull", has!("pmull")),
        ("sha2", has!("sha2")),
    ]
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn features() -> Vec<(&'static str, bool)> {
    vec![("the kind x86-64 or Arm with 64 bits", false)]
}

/// Encryption of connections, and trusted certificates.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) fn config(roots: RootCerts) -> TlsConfig {
    TlsConfig::builder()
        .unversioned_rustls_crypto_provider(
            std::sync::Arc::new(rustls_graviola::default_provider()),
        )
        .root_certs(roots)
        .build()
}

/// Without cryptography: no `https` address is requested, see [`missing`].
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
pub(crate) fn config(roots: RootCerts) -> TlsConfig {
    TlsConfig::builder().root_certs(roots).build()
}
