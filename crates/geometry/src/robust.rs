//! Robust kernels and chi-square gates.
//!
//! A squared Mahalanobis residual of n normal components is chi-square distributed with n degrees of freedom; the gates
//! are its 95 % quantiles. For n = 2 the quantile is `-2 ln(1 - p)`; the others solve `P(n/2, x/2) = p` (regularised
//! incomplete gamma function), which a test verifies.

/// 95 % quantile, 1 degree of freedom (depth alone).
pub const CHI2_95_1: f64 = 3.841_458_820_694_124;
/// 95 % quantile, 2 degrees of freedom (a pixel).
pub const CHI2_95_2: f64 = 5.991_464_547_107_979;
/// 95 % quantile, 3 degrees of freedom (a pixel and its depth).
pub const CHI2_95_3: f64 = 7.814_727_903_251_179;

/// Weight of the Huber kernel (Huber 1964) for a squared Mahalanobis residual `chi2` and a gate `delta2` (also squared):
/// 1 inside, `delta / |r|` outside.
#[must_use]
pub fn huber_weight(chi2: f64, delta2: f64) -> f64 {
    if chi2 <= delta2 {
        1.0
    } else {
        (delta2 / chi2).sqrt()
    }
}

/// Cost of the Huber kernel for a squared residual: `chi2` inside, `2 delta |r| - delta^2` outside.
#[must_use]
pub fn huber_cost(chi2: f64, delta2: f64) -> f64 {
    if chi2 <= delta2 {
        chi2
    } else {
        2.0 * (delta2 * chi2).sqrt() - delta2
    }
}
