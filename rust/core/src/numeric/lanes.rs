//! Eight numbers treated alike, and code compiled for the vector units found at run time.
//!
//! Plain arrays: the compiler turns them into vector instructions inside [`vectorized`], and into ordinary ones
//! elsewhere, with the same bits but for fused multiplications.

use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers in a [`Lanes`].
pub(crate) const WIDTH: usize = 8;

/// Eight numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lanes(pub [f64; WIDTH]);

impl Lanes {
    pub const ZERO: Self = Self([0.0; WIDTH]);

    #[inline(always)]
    pub fn splat(x: f64) -> Self {
        Self([x; WIDTH])
    }

    /// The first number.
    #[inline(always)]
    pub fn first(self) -> f64 {
        self.0[0]
    }

    /// The eight numbers from the start of a slice.
    #[inline(always)]
    pub fn load(from: &[f64]) -> Self {
        Self(*from.first_chunk::<WIDTH>().expect("eight numbers"))
    }

    #[inline(always)]
    pub fn store(self, to: &mut [f64]) {
        *to.first_chunk_mut::<WIDTH>().expect("eight numbers") = self.0;
    }

    #[inline(always)]
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        let mut out = self.0;
        for x in &mut out {
            *x = f(*x);
        }
        Self(out)
    }

    #[inline(always)]
    pub fn zip(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut out = self.0;
        for k in 0..WIDTH {
            out[k] = f(self.0[k], other.0[k]);
        }
        Self(out)
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        self.map(f64::abs)
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// `yes` where this is positive, else `no`.
    #[inline(always)]
    pub fn where_positive(self, yes: Self, no: Self) -> Self {
        let mut out = no.0;
        for k in 0..WIDTH {
            out[k] = if self.0[k] > 0.0 { yes.0[k] } else { no.0[k] };
        }
        Self(out)
    }

    /// `self + a b`, in one rounding where the machine has it.
    #[inline(always)]
    pub fn add_product<const FUSED: bool>(self, a: f64, b: Self) -> Self {
        self.zip(b, |s, b| fused::<FUSED>(a, b, s))
    }

    /// Sum, always in the same order.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        self.0.iter().sum()
    }

    #[inline(always)]
    pub fn least(self) -> f64 {
        self.0.iter().fold(f64::INFINITY, |a, &b| if b < a { b } else { a })
    }
}

macro_rules! lane_by_lane {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $op b)
            }
        }
        impl $trait<Lanes> for f64 {
            type Output = Lanes;
            #[inline(always)]
            fn $method(self, other: Lanes) -> Lanes {
                other.map(|b| self $op b)
            }
        }
    )*};
}
lane_by_lane!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|x| -x)
    }
}

/// `a b + c`, in one rounding if `FUSED`.
#[inline(always)]
pub(crate) fn fused<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Work compiled once for every kind of vector unit; `FUSED` says whether it multiplies and adds at once.
///
/// Whatever `run` calls must be `#[inline(always)]`, or it is compiled for the least common machine.
pub(crate) trait Vectorizable {
    type Output;
    fn run<const FUSED: bool>(self) -> Self::Output;
}

/// Run on the best vector unit of this machine.
pub(crate) fn vectorized<W: Vectorizable>(work: W) -> W::Output {
    struct Dispatch<W>(W);
    impl<W: Vectorizable> WithSimd for Dispatch<W> {
        type Output = W::Output;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> W::Output {
            if S::F64_LANES > 1 { self.0.run::<true>() } else { self.0.run::<false>() }
        }
    }
    Arch::new().dispatch(Dispatch(work))
}
