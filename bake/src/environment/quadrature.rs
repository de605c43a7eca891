//! Gauss-Legendre rules for the environment's one-dimensional integrals.

/// Nodes in (0, 1) with weights that sum to 1.
#[derive(Clone, Debug)]
pub(super) struct Rule {
    pub nodes: Vec<(f64, f64)>,
}

impl Rule {
    /// The `count`-point rule, exact for polynomials of degree `2 count - 1`.
    ///
    /// Nodes are Newton-refined roots of the Legendre polynomial (Abramowitz and Stegun 25.4.30).
    pub fn gauss_legendre(count: usize) -> Self {
        let mut nodes = Vec::with_capacity(count);
        for i in 0..count {
            let guess = (i as f64 + 0.75) / (count as f64 + 0.5) * std::f64::consts::PI;
            let mut x = libm::cos(guess);
            let mut slope = 1.0;
            for _ in 0..16 {
                let (value, derivative) = legendre(count, x);
                slope = derivative;
                x -= value / derivative;
            }
            // The classical weight 2 / ((1 - x^2) P'^2), halved for the unit interval.
            nodes.push((0.5 - 0.5 * x, 1.0 / ((1.0 - x * x) * slope * slope)));
        }
        Self { nodes }
    }
}

/// Value and derivative of the Legendre polynomial of the given degree at `x`.
fn legendre(degree: usize, x: f64) -> (f64, f64) {
    let (mut previous, mut current) = (1.0, x);
    for k in 2..=degree {
        let k = k as f64;
        let next = ((2.0 * k - 1.0) * x * current - (k - 1.0) * previous) / k;
        previous = current;
        current = next;
    }
    let derivative = degree as f64 * (x * current - previous) / (x * x - 1.0);
    (current, derivative)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_integrate_monomials_exactly() {
        for count in [2_usize, 3, 8, 24, 32] {
            let rule = Rule::gauss_legendre(count);
            for degree in 0..2 * count {
                let sum: f64 = rule
                    .nodes
                    .iter()
                    .map(|&(x, w)| w * libm::pow(x, degree as f64))
                    .sum();
                let exact = 1.0 / (degree as f64 + 1.0);
                assert!(
                    (sum - exact).abs() < 1e-13,
                    "{count} points, degree {degree}"
                );
            }
        }
    }
}
