//! Dual numbers: the exact derivative of generic code in one direction, as the oracle of the hand-derived adjoints.

use crate::scalar::Scalar;
use mde_uncertainty::Real;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// \\(x + x' \varepsilon\\) with \\(\varepsilon^2 = 0\\): a value and its derivative in one direction. Comparisons, `max` and
/// `min` go by the value, then by the derivative, since \\(\varepsilon\\) is smaller than any number; truncation by the value.
#[derive(Debug, Clone, Copy, Default, PartialEq, PartialOrd)]
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

impl Dual {
    /// The variable that is differentiated.
    pub(crate) fn variable(value: f64) -> Self {
        Self { value, slope: 1.0 }
    }

    /// \\(f(x) + f'(x) x' \varepsilon\\).
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: derivative * self.slope }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (self.slope - value * other.slope) / other.value }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl AddAssign for Dual {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sum for Dual {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Self::add)
    }
}

impl Real for Dual {
    const ZERO: Self = Self { value: 0.0, slope: 0.0 };
    const ONE: Self = Self { value: 1.0, slope: 0.0 };

    fn from_f64(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    fn to_f64(self) -> f64 {
        self.value
    }

    fn exp(self) -> Self {
        self.chain(self.value.exp(), self.value.exp())
    }

    fn exp_m1(self) -> Self {
        self.chain(self.value.exp_m1(), self.value.exp())
    }

    fn sqrt(self) -> Self {
        self.chain(self.value.sqrt(), 0.5 / self.value.sqrt())
    }
}

impl Scalar for Dual {
    fn sin_pi(self) -> Self {
        self.chain(self.value.sin_pi(), std::f64::consts::PI * self.value.cos_pi())
    }

    fn cos_pi(self) -> Self {
        self.chain(self.value.cos_pi(), -std::f64::consts::PI * self.value.sin_pi())
    }
}
