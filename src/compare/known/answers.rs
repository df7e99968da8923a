//! Answers known in closed form: configuration factors and exact solutions of the radiosity equation.
//!
//! Letters: E₀ exitance, ρ albedo, H irradiance, B = E₀ + ρH radiosity, S area; everything in f64.
//! This work is based on: Howell, "A Catalog of Radiation Heat Transfer Configuration Factors" (numbers in brackets);
//! Lambert, "Photometria" 1760, for polygons. `tests/known_answers.rs` holds the formulas to the printed tables.

use std::f64::consts::PI;

use glam::DVec3;

/// Parallel, directly opposed, equal rectangles of sides a, b at distance c: X = a/c, Y = b/c [C-11].
pub fn parallel_rectangles(x: f64, y: f64) -> f64 {
    let (xx, yy) = (1.0 + x * x, 1.0 + y * y);
    let log = 0.5 * (xx * yy / (xx + y * y)).ln();
    let cross = x * yy.sqrt() * (x / yy.sqrt()).atan() + y * xx.sqrt() * (y / xx.sqrt()).atan();
    2.0 / (PI * x * y) * (log + cross - x * x.atan() - y * y.atan())
}

/// Perpendicular rectangles that share an edge of length l: from the one of width w to the one of height h,
/// H = h/l, W = w/l [C-14].
pub fn perpendicular_rectangles(h: f64, w: f64) -> f64 {
    let (hh, ww) = (h * h, w * w);
    let sum = hh + ww;
    let flat = w * (1.0 / w).atan() + h * (1.0 / h).atan() - sum.sqrt() * (1.0 / sum.sqrt()).atan();
    let log = ((1.0 + ww) * (1.0 + hh) / (1.0 + sum)).ln()
        + ww * (ww * (1.0 + sum) / ((1.0 + ww) * sum)).ln()
        + hh * (hh * (1.0 + sum) / ((1.0 + hh) * sum)).ln();
    (flat + 0.25 * log) / (PI * w)
}

/// Unit squares hinged along an edge: (opening in degrees, factor) [C-16], to the digits given.
pub const HINGED_SQUARES: [(f64, f64); 6] = [
    (30.0, 0.61903),
    (45.0, 0.483348),
    (60.0, 0.370905),
    (90.0, 0.2000438),
    (120.0, 0.0866150),
    (135.0, 0.0483094),
];

/// Coaxial parallel discs, from the one of radius `from` to the one of radius `to` at `distance` [C-41].
pub fn coaxial_discs(from: f64, to: f64, distance: f64) -> f64 {
    let (r1, r2) = (from / distance, to / distance);
    let x = 1.0 + (1.0 + r2 * r2) / (r1 * r1);
    0.5 * (x - (x * x - 4.0 * (r2 / r1) * (r2 / r1)).sqrt())
}

/// An element facing a parallel rectangle a × b at distance c, under one of its corners [B-3].
pub fn point_under_corner(a: f64, b: f64, c: f64) -> f64 {
    let (x, y) = (a / c, b / c);
    let (sx, sy) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / sx * (y / sx).atan() + y / sy * (x / sy).atan()) / (2.0 * PI)
}

/// An element facing a parallel rectangle a × b at distance c, under its centre: four corners.
pub fn point_under_centre(a: f64, b: f64, c: f64) -> f64 {
    4.0 * point_under_corner(0.5 * a, 0.5 * b, c)
}

/// An element whose plane is perpendicular to a unit square that starts at that plane, beside the square's corner and
/// at distance c before it [B-4].
pub fn point_perpendicular_to_square(c: f64) -> f64 {
    let far = (1.0 + c * c).sqrt();
    ((1.0 / c).atan() - c / far * (1.0 / far).atan()) / (2.0 * PI)
}

/// An element facing the centre of a parallel disc [B-12].
pub fn point_to_disc(radius: f64, distance: f64) -> f64 {
    radius * radius / (radius * radius + distance * distance)
}

/// An element at `point` with unit `normal` to any polygon that lies wholly above its plane (Lambert):
/// (1/2π) Σ γᵢ (n·Γᵢ), positive when the corners run clockwise as seen from the element.
pub fn point_to_polygon(point: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let rays: Vec<DVec3> = corners.iter().map(|c| (*c - point).normalize()).collect();
    let sum: f64 = (0..rays.len())
        .map(|i| {
            let (a, b) = (rays[i], rays[(i + 1) % rays.len()]);
            a.dot(b).clamp(-1.0, 1.0).acos() * normal.dot(b.cross(a).normalize_or_zero())
        })
        .sum();
    sum / (2.0 * PI)
}

/// The factor between any two faces of a regular tetrahedron, by symmetry.
pub const TETRAHEDRON: f64 = 1.0 / 3.0;

/// Irradiance in a closed scene of uniform exitance and albedo, occluders inside included: E₀/(1−ρ); B is the same.
pub fn furnace(exitance: f64, albedo: f64) -> f64 {
    exitance / (1.0 - albedo)
}

/// A zone of a sphere seen from inside.
#[derive(Debug, Clone, Copy)]
pub struct Zone {
    /// Share of the sphere's area; all shares add up to 1.
    pub share: f64,
    /// Exitance.
    pub exitance: f64,
    /// Albedo.
    pub albedo: f64,
}

/// The irradiance inside a sphere, the same everywhere: H = ⟨E₀⟩/(1−⟨ρ⟩).
pub fn sphere_interior(zones: &[Zone]) -> f64 {
    let exitance: f64 = zones.iter().map(|z| z.share * z.exitance).sum();
    let albedo: f64 = zones.iter().map(|z| z.share * z.albedo).sum();
    exitance / (1.0 - albedo)
}

/// The share of a cap's hemispheres that the cap itself fills: f = (1−cos β)/2, β the cap's half-angle.
pub fn crater_share(half_angle: f64) -> f64 {
    0.5 * (1.0 - half_angle.cos())
}

/// Irradiance that a sunlit spherical-cap crater sends into itself, the same at each of its points, shadowed or not:
/// H = ρ F₀ sin e · f(1−f)/(1−ρf), F₀ the sun's irradiance facing it, e its elevation above the rim's plane.
pub fn crater(half_angle: f64, elevation: f64, albedo: f64, sun: f64) -> f64 {
    let f = crater_share(half_angle);
    albedo * sun * elevation.sin() * f * (1.0 - f) / (1.0 - albedo * f)
}

/// Radiosities of the inner sphere's outside and the outer sphere's inside.
///
/// `radii`, `exitances`, `albedos`: inner first. F₁₂ = 1, F₂₁ = (r₁/r₂)², F₂₂ = 1 − F₂₁.
pub fn concentric_spheres(radii: [f64; 2], exitances: [f64; 2], albedos: [f64; 2]) -> [f64; 2] {
    let back = (radii[0] / radii[1]) * (radii[0] / radii[1]);
    // B₁ = E₁ + ρ₁B₂ and B₂ = E₂ + ρ₂(F₂₁B₁ + F₂₂B₂).
    let outer = (exitances[1] + albedos[1] * back * exitances[0])
        / (1.0 - albedos[1] * (1.0 - back) - albedos[1] * back * albedos[0]);
    [exitances[0] + albedos[0] * outer, outer]
}

/// Radiosity of the first of two infinite parallel plates: (E₁ + ρ₁E₂)/(1 − ρ₁ρ₂).
pub fn parallel_plates(exitances: [f64; 2], albedos: [f64; 2]) -> f64 {
    (exitances[0] + albedos[0] * exitances[1]) / (1.0 - albedos[0] * albedos[1])
}

/// Face means of a unit cube lit by its ceiling, E₀ = 1.
#[derive(Debug, Clone, Copy)]
pub struct Cube {
    /// Albedo of walls and floor.
    pub albedo: f64,
    /// Albedo of the ceiling.
    pub ceiling_albedo: f64,
    /// Mean radiosity of a wall.
    pub wall: f64,
    /// Mean radiosity of the floor.
    pub floor: f64,
    /// Mean irradiance of the ceiling.
    pub ceiling_irradiance: f64,
}

/// The three solved cubes; continuous solutions, good to about 1e-7 in radiosity.
pub const CUBES: [Cube; 3] = [
    Cube {
        albedo: 0.5,
        ceiling_albedo: 0.5,
        wall: 0.1811056,
        floor: 0.1712161,
        ceiling_irradiance: (1.1043613 - 1.0) / 0.5,
    },
    Cube {
        albedo: 0.8,
        ceiling_albedo: 0.8,
        wall: 0.6878789,
        floor: 0.6609798,
        ceiling_irradiance: (1.5875044 - 1.0) / 0.8,
    },
    Cube {
        albedo: 0.5,
        ceiling_albedo: 0.0,
        wall: 0.1639926,
        floor: 0.1551747,
        ceiling_irradiance: 0.1888551,
    },
];

/// Mean irradiance of any closed enclosure of uniform albedo into which the flux Φ is emitted: Φ/(S(1−ρ)).
pub fn enclosure_mean(flux: f64, area: f64, albedo: f64) -> f64 {
    flux / (area * (1.0 - albedo))
}

/// Mean indirect irradiance of an enclosure in which a point source of flux Φ hangs: (Φ/S)·ρ/(1−ρ).
pub fn point_room_indirect(flux: f64, area: f64, albedo: f64) -> f64 {
    flux / area * albedo / (1.0 - albedo)
}

/// Direct irradiance on a wall of a cubic room of edge `edge` from an isotropic source of flux Φ at its centre, at
/// (x, y) from the wall's centre: Φ/(4π) · d/(d² + x² + y²)^{3/2}, d = edge/2.
pub fn point_room_direct(flux: f64, edge: f64, x: f64, y: f64) -> f64 {
    let d = 0.5 * edge;
    flux / (4.0 * PI) * d / (d * d + x * x + y * y).powf(1.5)
}

/// Exponents of B ≈ c₀ + c₁ r^β at a 90° concave edge: (albedo, β).
pub const CREASE_EXPONENTS: [(f64, f64); 7] = [
    (0.1, 0.9507),
    (0.25, 0.8790),
    (0.5, 0.7634),
    (0.7, 0.6726),
    (0.8, 0.6274),
    (0.9, 0.5820),
    (0.99, 0.5409),
];
