//! Real spherical harmonics: light that comes from far away, by a few numbers.
//!
//! This work is based on: Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
//! SIGGRAPH 2001 (the factors from radiance to irradiance); Sloan, Kautz and Snyder, "Precomputed Radiance Transfer",
//! SIGGRAPH 2002; the basis, its signs and its order are those of Sloan, "Stupid Spherical Harmonics (SH) Tricks", GDC 2008.
//!
//! The frame has the sky's up for its third axis, so that turning the sky mixes a function with its own partner alone; the
//! first points to the middle of a latitude–longitude image, the second to a quarter left of it. For a scene with +y up that
//! is its directions (z, x, y); for another axis up it is tilted by the shortest rotation from +y, as images are
//! (`docs/transfer.md`). Function number l (l + 1) + m is Y of degree l and order m, m from −l to l.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use super::Rgb;

/// The most bands there are.
pub const MOST_ORDER: usize = 4;

/// Functions of [`MOST_ORDER`] bands.
pub const MOST: usize = MOST_ORDER * MOST_ORDER;

/// From coefficients of radiance to those of irradiance, by degree.
const COSINE: [f64; MOST_ORDER] = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0];

/// Points and weights of Gauss and Legendre on [−1, 1], the positive half of eight: exact to degree 15.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// A function of direction with an n-th of the bands that a sky has: n² coefficients a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Harmonics {
    /// By number; of radiance, W·m⁻²·sr⁻¹ times √sr.
    pub coefficients: Vec<Rgb>,
}

/// All functions at a unit direction of the harmonics' frame.
pub fn basis(direction: Vec3) -> [f32; MOST] {
    basis_f64(direction.as_dvec3()).map(|y| y as f32)
}

/// As [`basis`], in double precision.
fn basis_f64(direction: DVec3) -> [f64; MOST] {
    let DVec3 { x, y, z } = direction;
    let c = |square: f64, over: f64| (square / PI).sqrt() / over;
    [
        c(1.0, 2.0),
        -c(3.0, 2.0) * y,
        c(3.0, 2.0) * z,
        -c(3.0, 2.0) * x,
        c(15.0, 2.0) * x * y,
        -c(15.0, 2.0) * y * z,
        c(5.0, 4.0) * (3.0 * z * z - 1.0),
        -c(15.0, 2.0) * x * z,
        c(15.0, 4.0) * (x * x - y * y),
        -c(70.0, 8.0) * y * (3.0 * x * x - y * y),
        c(105.0, 2.0) * x * y * z,
        -c(42.0, 8.0) * y * (5.0 * z * z - 1.0),
        c(7.0, 4.0) * z * (5.0 * z * z - 3.0),
        -c(42.0, 8.0) * x * (5.0 * z * z - 1.0),
        c(105.0, 4.0) * z * (x * x - y * y),
        -c(70.0, 8.0) * x * (x * x - 3.0 * y * y),
    ]
}

/// Degree and order of a function.
fn degree(number: usize) -> (usize, i32) {
    let l = number.isqrt();
    (l, number as i32 - (l * (l + 1)) as i32)
}

impl Harmonics {
    /// The same radiance from everywhere.
    pub fn constant(radiance: Rgb, order: usize) -> Self {
        let mut coefficients = vec![Rgb::ZERO; order * order];
        coefficients[0] = (radiance.as_dvec3() * (4.0 * PI).sqrt()).as_vec3();
        Self { coefficients }
    }

    /// One function, as large as one in every channel.
    ///
    /// # Panics
    /// When there is no such function.
    pub fn unit(number: usize, order: usize) -> Self {
        let mut coefficients = vec![Rgb::ZERO; order * order];
        coefficients[number] = Rgb::ONE;
        Self { coefficients }
    }

    /// Projects a latitude–longitude image, zenith first, in its own frame: the integral of what bilinear look-ups give, columns
    /// in closed form and rows by quadrature to rounding. Cost: some 10 ns a pixel.
    ///
    /// # Panics
    /// When there are not `width` × n pixels, or more than [`MOST_ORDER`] bands are asked for.
    pub fn project(width: usize, pixels: &[Rgb], order: usize) -> Self {
        assert!((1..=MOST_ORDER).contains(&order) && pixels.len().is_multiple_of(width), "whole rows");
        let weights = row_weights(pixels.len() / width);
        let waves: Vec<[f64; 2 * MOST_ORDER - 1]> = (0..width).map(|column| waves(column, width)).collect();
        let mut sums = vec![DVec3::ZERO; order * order];
        for (row, weights) in pixels.chunks_exact(width).zip(&weights) {
            let mut by_wave = [DVec3::ZERO; 2 * MOST_ORDER - 1];
            for (pixel, waves) in row.iter().zip(&waves) {
                let pixel = pixel.as_dvec3();
                by_wave.iter_mut().zip(waves).for_each(|(sum, wave)| *sum += pixel * *wave);
            }
            for (number, sum) in sums.iter_mut().enumerate() {
                let (_, m) = degree(number);
                *sum += by_wave[(m + MOST_ORDER as i32 - 1) as usize] * weights[number];
            }
        }
        Self { coefficients: sums.into_iter().map(DVec3::as_vec3).collect() }
    }

    /// Bands.
    pub fn order(&self) -> usize {
        self.coefficients.len().isqrt()
    }

    /// The first bands of it.
    #[must_use]
    pub fn truncated(mut self, order: usize) -> Self {
        self.coefficients.truncate(order * order);
        self
    }

    /// Turned about the up by degrees, counter-clockwise from above. Exact.
    #[must_use]
    pub fn turned(&self, degrees: f32) -> Self {
        let angle = f64::from(degrees).to_radians();
        let own = |number: usize| self.coefficients[number].as_dvec3();
        let turned = |number: usize| {
            let (l, m) = degree(number);
            let (sine, cosine) = (f64::from(m) * angle).sin_cos();
            // Of cos mφ where m > 0 and of sin |m|φ where m < 0; the sine has the sign of m.
            let partner = (l * (l + 1)) as i32 - m;
            (own(number) * cosine - own(partner as usize) * sine).as_vec3()
        };
        Self { coefficients: (0..self.coefficients.len()).map(turned).collect() }
    }

    /// Times a colour.
    #[must_use]
    pub fn tinted(mut self, by: Rgb) -> Self {
        self.coefficients.iter_mut().for_each(|c| *c *= by);
        self
    }

    /// The radiance that arrives from a unit direction of the frame, W·m⁻²·sr⁻¹. It may be negative.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        self.coefficients.iter().zip(basis(direction)).map(|(c, y)| *c * y).sum()
    }

    /// Irradiance of a plane that nothing stands on, by its unit normal in the frame, W·m⁻². Bands beyond the third have no part
    /// in it.
    pub fn irradiance(&self, normal: Vec3) -> Rgb {
        let terms = self.coefficients.iter().zip(basis_f64(normal.as_dvec3())).enumerate();
        let term = |(number, (c, y)): (usize, (&Rgb, f64))| c.as_dvec3() * (COSINE[degree(number).0] * y);
        terms.map(term).sum::<DVec3>().as_vec3()
    }
}

/// The integrals of cos mφ (m ≥ 0) and sin |m|φ (m < 0) against a column's tent; φ falls from left to right.
fn waves(column: usize, width: usize) -> [f64; 2 * MOST_ORDER - 1] {
    let step = TAU / width as f64;
    let angle = PI - (column as f64 + 0.5) * step;
    std::array::from_fn(|k| {
        let m = k as f64 - (MOST_ORDER as f64 - 1.0);
        let half = 0.5 * m * step;
        let damped = if half == 0.0 { 1.0 } else { (half.sin() / half).powi(2) };
        let wave = if m < 0.0 { (-m * angle).sin() } else { (m * angle).cos() };
        step * damped * wave
    })
}

/// Per row the integral of each function's part in the polar angle against the row's tent and sin θ; beyond the first and the
/// last row's middle there are these rows alone.
fn row_weights(rows: usize) -> Vec<[f64; MOST]> {
    let mut weights = vec![[0.0; MOST]; rows];
    let middle = |row: usize| PI * (row as f64 + 0.5) / rows as f64;
    for interval in 0..=rows {
        let low = if interval == 0 { 0.0 } else { middle(interval - 1) };
        let high = if interval == rows { PI } else { middle(interval) };
        let (half, centre) = (0.5 * (high - low), 0.5 * (low + high));
        for (at, weight) in GAUSS.iter().flat_map(|&(at, weight)| [(at, weight), (-at, weight)]) {
            let (sine, cosine) = (centre + half * at).sin_cos();
            let values = basis_f64(DVec3::new(sine, 0.0, cosine));
            let share = 0.5 * (1.0 + at);
            let parts = [(interval.saturating_sub(1), 1.0 - share), (interval.min(rows - 1), share)];
            for (row, part) in parts {
                for (number, sum) in weights[row].iter_mut().enumerate() {
                    // Partners have the same part in the polar angle.
                    let (l, m) = degree(number);
                    *sum += values[l * (l + 1) + m.unsigned_abs() as usize] * half * weight * part * sine;
                }
            }
        }
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions and weights of a quadrature over the sphere, exact for products of two functions: Gauss and Legendre in z
    /// (degree 15), 16 equal steps around.
    fn quadrature() -> Vec<(Vec3, f64)> {
        let mut points = Vec::new();
        for (z, weight) in GAUSS.iter().flat_map(|&(z, weight)| [(z, weight), (-z, weight)]) {
            for k in 0..16 {
                let (sine, cosine) = (TAU * (f64::from(k) + 0.3) / 16.0).sin_cos();
                let r = (1.0 - z * z).sqrt();
                points.push((DVec3::new(r * cosine, r * sine, z).as_vec3(), weight * TAU / 16.0));
            }
        }
        points
    }

    fn coloured(seed: u32) -> Harmonics {
        let value = |k: u32| {
            let word = (seed * 977 + k).wrapping_mul(2_654_435_761);
            (f64::from(word) / f64::from(u32::MAX) - 0.5) as f32
        };
        let number = |k: u32| Rgb::new(value(3 * k), value(3 * k + 1), value(3 * k + 2));
        Harmonics { coefficients: (0..MOST as u32).map(number).collect() }
    }

    /// The direction of a pixel's middle: the layout that the module's documentation tells.
    fn middle(width: usize, height: usize, k: usize) -> Vec3 {
        let (row, column) = (k / width, k % width);
        let (sine, cosine) = (PI * (row as f64 + 0.5) / height as f64).sin_cos();
        let (y, x) = (PI - TAU * (column as f64 + 0.5) / width as f64).sin_cos();
        DVec3::new(sine * x, sine * y, cosine).as_vec3()
    }

    fn panorama(sky: &Harmonics, width: usize, height: usize) -> Vec<Rgb> {
        (0..width * height).map(|k| sky.radiance(middle(width, height, k))).collect()
    }

    #[test]
    fn the_functions_are_orthonormal() {
        let mut products = [[0.0; MOST]; MOST];
        for (direction, weight) in quadrature() {
            let y = basis(direction);
            for a in 0..MOST {
                (0..MOST).for_each(|b| products[a][b] += weight * f64::from(y[a] * y[b]));
            }
        }
        for (a, row) in products.iter().enumerate() {
            for (b, product) in row.iter().enumerate() {
                // Sums of 128 products in f32, each of a few roundings: 1e-5.
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < 1.0e-5, "{a}, {b}: {product}");
            }
        }
    }

    #[test]
    fn signs_and_order_are_those_of_the_convention() {
        let y = basis(Vec3::X);
        assert!((y[3] + 0.488_602_5).abs() < 1e-6 && (y[8] - 0.546_274_2).abs() < 1e-6, "{y:?}");
        assert!((basis(Vec3::Y)[1] + 0.488_602_5).abs() < 1e-6);
        assert!(
            (basis(Vec3::Z)[2] - 0.488_602_5).abs() < 1e-6 && (basis(Vec3::Z)[0] - 0.282_094_8).abs() < 1e-6
        );
        assert_eq!((degree(0), degree(1), degree(3), degree(15)), ((0, 0), (1, -1), (1, 1), (3, 3)));
    }

    #[test]
    fn projecting_what_has_four_bands_gives_it_back() {
        let sky = coloured(1);
        let (width, height) = (512, 256);
        let found = Harmonics::project(width, &panorama(&sky, width, height), MOST_ORDER);
        for (a, b) in found.coefficients.iter().zip(&sky.coefficients) {
            // Bilinear look-ups flatten waves: sinc² of half a step of the third around, 1.1e-4, and as much along rows.
            assert!((*a - *b).abs().max_element() < 2.0e-4, "{a} {b}");
        }
    }

    #[test]
    fn coarse_images_are_integrated_exactly() {
        // 4 × 2 pixels, all 1: a constant, whatever the tents.
        let found = Harmonics::project(4, &[Rgb::splat(2.0); 8], 3);
        let expected = Harmonics::constant(Rgb::splat(2.0), 3);
        for (a, b) in found.coefficients.iter().zip(&expected.coefficients) {
            // Eight points of Gauss and Legendre on an interval of π/2: to rounding of f32.
            assert!((*a - *b).abs().max_element() < 2.0e-6, "{a} {b}");
        }
        // Upper row 1, lower 0: radiance 1 above 45°, falling linearly in the angle to 0 at 135°. Its mean over z is
        // ½ (∫₀^{π/4} sin + ∫ (3π/4 − θ)/(π/2) sin) = ½ (1 − √½ + √½) = ½: by symmetry. Its first moment is ∫ f cos sin dθ / 2:
        // ½ (¼ + ¼ · 2/π): of cos θ sin θ = ½ sin 2θ, ∫₀^{π/4} = ¼, ∫ over the slope = −∫ g' = (1/(π/2)) · ¼ · 1.
        let pixels: Vec<Rgb> = (0..8).map(|k| if k < 4 { Rgb::ONE } else { Rgb::ZERO }).collect();
        let found = Harmonics::project(4, &pixels, 2);
        let mean = f64::from(found.coefficients[0].x) / (4.0 * PI).sqrt();
        assert!((mean - 0.5).abs() < 1.0e-6, "{mean}");
        // ∫₀^π f cos sin dθ by parts: ∫ −f' ½ sin² dθ = (2/π) ½ ∫_{π/4}^{3π/4} sin² = (1/π)(π/4 + ½).
        let moment = (0.25 * PI + 0.5) / PI * TAU * (3.0 / (4.0 * PI)).sqrt();
        assert!(
            (f64::from(found.coefficients[2].x) - moment).abs() < 1.0e-6,
            "{} {moment}",
            found.coefficients[2]
        );
    }

    #[test]
    fn turning_coefficients_is_turning_the_sky() {
        let sky = coloured(2);
        let (width, height) = (64, 32);
        let image = panorama(&sky, width, height);
        // Counter-clockwise from above is towards the left of the image, which is seen from within: φ falls to the right.
        let by = 9;
        let moved = |k: usize| image[k / width * width + (k % width + by) % width];
        let turned_image: Vec<Rgb> = (0..width * height).map(moved).collect();
        let projected = Harmonics::project(width, &turned_image, MOST_ORDER);
        let turned = Harmonics::project(width, &image, MOST_ORDER).turned(by as f32 * 360.0 / width as f32);
        for (a, b) in projected.coefficients.iter().zip(&turned.coefficients) {
            // The same sums in another order.
            assert!((*a - *b).abs().max_element() < 1.0e-5, "{a} {b}");
        }
        // And a direction of the turned sky is one of the sky, turned back.
        let direction = Vec3::new(0.6, 0.0, 0.8);
        let back = glam::Quat::from_rotation_z(-0.7) * direction;
        let (now, then) = (sky.turned(0.7f32.to_degrees()).radiance(direction), sky.radiance(back));
        assert!((now - then).length() < 1.0e-5, "{now} {then}");
    }

    #[test]
    fn a_plane_gets_what_the_sky_sends_it() {
        let sky = coloured(3);
        for normal in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.64, -0.6)] {
            let mut sum = DVec3::ZERO;
            // The cosine has a kink, which steps of 1/400 see to some 1e-5.
            let (width, height) = (800, 400);
            for k in 0..width * height {
                let direction = middle(width, height, k);
                let edge = |row: usize| (PI * row as f64 / height as f64).cos();
                let area = (edge(k / width) - edge(k / width + 1)) * TAU / width as f64;
                let cosine = f64::from(direction.dot(normal).max(0.0));
                sum += sky.radiance(direction).as_dvec3() * (cosine * area);
            }
            let found = sky.irradiance(normal);
            assert!((found - sum.as_vec3()).abs().max_element() < 1.0e-4, "{found} {sum}");
        }
        let even = Harmonics::constant(Rgb::ONE, 4);
        assert!((even.irradiance(Vec3::Y).x - std::f32::consts::PI).abs() < 1.0e-6);
    }
}
