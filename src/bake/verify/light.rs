//! Invariants of the light: finite, not negative, and what the links make of it.

use glam::Vec3;

use super::archives::Opened;
use super::links::Linked;
use super::rows::rays_of;
use super::sites::{LIGHT, Sited, is_light};
use super::{Report, each};

/// A site's radiosity is a sum of some seventy products in f32; twice as many roundings of its size are allowed.
const ROUNDING: f32 = 128.0 * f32::EPSILON;

/// Checks `light.glow`.
pub(super) fn check(file: &Opened, (sites, links): (&Sited<'_>, &Linked<'_>), report: &mut Report) {
    if let Some(level) = file.sized::<f32>(report, "level", 3) {
        file.hold(report, "level", each(level, SIZE, is_size));
    }
    file.sized::<u32>(report, "field", 6);
    let Some(receivers) = links.receivers else { return };
    let irradiance = file.sized::<Vec3>(report, "irradian", receivers);
    if let Some(irradiance) = irradiance {
        file.hold(report, "irradian", each(irradiance, LIGHT, is_light));
    }
    if let Some(gradient) = file.sized::<[f32; 9]>(report, "gradient", receivers) {
        let finite = |g: &[f32; 9]| g.iter().all(|v| v.is_finite());
        file.hold(report, "gradient", each(gradient, "finite numbers", finite));
    }
    for tag in ["surplus", "noise"] {
        if let Some(values) = file.sized::<f32>(report, tag, receivers) {
            file.hold(report, tag, each(values, SIZE, is_size));
        }
    }
    if let Some(seen) = file.sized::<f32>(report, "sky_seen", receivers) {
        file.hold(report, "sky_seen", sky(seen, links));
    }
    let Some(sites_number) = sites.count else { return };
    let Some(radiosity) = file.sized::<Vec3>(report, "radiosit", sites_number) else { return };
    let sound = file.hold(report, "radiosit", each(radiosity, LIGHT, is_light));
    if let (true, Some(irradiance)) = (sound, irradiance) {
        file.hold(report, "radiosit", reflected(radiosity, irradiance, (sites, links)));
    }
}

const SIZE: &str = "finite numbers from 0 on";

fn is_size(value: &f32) -> bool {
    value.is_finite() && *value >= 0.0
}

/// The share of the sky that a receiver sees is that of its rays that escaped.
fn sky(seen: &[f32], links: &Linked<'_>) -> Result<(), String> {
    let (Some(tables), Some(sums)) = (&links.tables, links.sums) else {
        return each(seen, "shares within [0, 1]", |s| (0.0..=1.0).contains(s));
    };
    for (row, (&seen, &[.., escaped])) in seen.iter().zip(sums).enumerate() {
        let expected = escaped as f32 / rays_of(tables, row) as f32;
        if seen != expected {
            return Err(format!("entry {row}: expected {expected} of the sky, got {seen}"));
        }
    }
    Ok(())
}

/// B = E + ρ (D + P·H) at every site, within rounding: glow, and what lamps and receivers bring.
fn reflected(
    radiosity: &[Vec3],
    irradiance: &[Vec3],
    (sites, links): (&Sited<'_>, &Linked<'_>),
) -> Result<(), String> {
    let (Some(albedo), Some(exitance)) = (sites.albedo, sites.exitance) else { return Ok(()) };
    let (Some(lamps), Some(spread)) = (&links.lamps, &links.spread) else { return Ok(()) };
    for (site, &got) in radiosity.iter().enumerate() {
        let expected = exitance[site] + albedo[site] * (lamps.at(site) + spread.push(site, irradiance));
        if (got - expected).abs().max_element() > ROUNDING * expected.max_element() {
            return Err(format!("site {site}: expected radiosity {expected}, got {got}"));
        }
    }
    Ok(())
}
