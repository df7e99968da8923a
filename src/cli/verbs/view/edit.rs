//! What a page asks for: other albedos, lamps elsewhere, a sky turned.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::bake::Lighting;
use crate::bake::relight::Paint;
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::{Albedo, LampKind, Mesh, Scene, nearest_word};

/// All that differs from the bake; what is left out is as baked.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Edit {
    /// By mesh, each channel in [0, 1).
    pub albedo: BTreeMap<String, [f32; 3]>,
    /// By lamp.
    pub lamps: BTreeMap<String, Place>,
    /// How an image sky is turned, degrees as a scene file's `rotate`.
    pub rotate: Option<f32>,
    /// The versions of the layers that the page holds.
    pub have: Vec<u64>,
}

/// Where a lamp is, in world coordinates.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Place {
    /// Of points and spots.
    pub position: Option<[f64; 3]>,
    /// Of suns and spots: the way the light travels.
    pub direction: Option<[f64; 3]>,
}

impl Edit {
    /// From JSON.
    ///
    /// # Errors
    /// [`Error::Usage`] for what is no such JSON.
    pub fn read(text: &[u8]) -> Result<Self> {
        serde_json::from_slice(text).map_err(|e| Error::Usage(format!("no edit: {e}")))
    }

    /// The lighting that is baked with these changes.
    ///
    /// # Errors
    /// [`Error::Usage`] with the name that is unknown or the value that has no meaning.
    pub fn lighting(&self, scene: &Scene, baked: &Lighting) -> Result<Lighting> {
        let mut lighting = baked.clone();
        for (name, albedo) in &self.albedo {
            let mesh = place_of(name, scene.meshes.iter().map(|mesh| mesh.name.as_str()))?;
            lighting.meshes[mesh].paint = Paint::Plain(Rgb::from_array(*albedo));
        }
        for (name, place) in &self.lamps {
            let lamp = place_of(name, scene.lamps.iter().map(|lamp| lamp.name.as_str()))?;
            place.put(&mut lighting.lamps[lamp], scene).map_err(|e| Error::Usage(format!("{name}: {e}")))?;
        }
        if let Some(degrees) = self.rotate {
            let image = lighting.sky.as_mut().filter(|sky| sky.constant.is_none());
            let sky = image.ok_or_else(|| Error::Usage("there is no image sky to turn".into()))?;
            if !degrees.is_finite() {
                return Err(Error::Usage("the sky's turn is no finite number".into()));
            }
            sky.rotate_degrees = degrees;
        }
        lighting.check(scene)?;
        Ok(lighting)
    }
}

impl Place {
    fn put(&self, kind: &mut LampKind, scene: &Scene) -> Result<(), &'static str> {
        let (position, direction) = match kind {
            LampKind::Sun { direction, .. } => (None, Some(direction)),
            LampKind::Point { position, .. } => (Some(position), None),
            LampKind::Spot { position, direction, .. } => (Some(position), Some(direction)),
        };
        if let Some(to) = self.position {
            let local = scene.placement.to_local(DVec3::from_array(to));
            *position.ok_or("a sun has no position")? = finite(local).ok_or("a position out of reach")?;
        }
        if let Some(to) = self.direction {
            let unit = DVec3::from_array(to).try_normalize().map(|unit| unit.as_vec3());
            let unit = unit.and_then(finite).ok_or("a direction of no length")?;
            *direction.ok_or("a point lamp has no direction")? = unit;
        }
        Ok(())
    }
}

fn finite(vector: Vec3) -> Option<Vec3> {
    Some(vector).filter(|vector| vector.is_finite())
}

fn place_of<'a>(name: &str, names: impl Iterator<Item = &'a str> + Clone) -> Result<usize> {
    names.clone().position(|own| own == name).ok_or_else(|| {
        let near = nearest_word(name, names).map(|near| format!("; the nearest valid name is `{near}`"));
        Error::Usage(format!("unknown name `{name}`{}", near.unwrap_or_default()))
    })
}

/// What the page's controls begin with: names, albedos, places of lamps in world coordinates, the turn of the sky.
pub fn controls(scene: &Scene, baked: &Lighting) -> Value {
    let world = |position: &Vec3| scene.placement.to_world(*position).to_array();
    let lamp = |lamp: &crate::scene::Lamp| match &lamp.kind {
        LampKind::Sun { direction, .. } => json!({ "name": lamp.name, "direction": direction.to_array() }),
        LampKind::Point { position, .. } => json!({ "name": lamp.name, "position": world(position) }),
        LampKind::Spot { position, direction, .. } => {
            json!({ "name": lamp.name, "position": world(position), "direction": direction.to_array() })
        }
    };
    let turn = baked.sky.as_ref().filter(|sky| sky.constant.is_none());
    json!({
        "meshes": scene.meshes.iter().map(|mesh| json!({ "name": mesh.name, "albedo": mean_albedo(mesh).to_array() }))
            .collect::<Vec<_>>(),
        "lamps": scene.lamps.iter().map(lamp).collect::<Vec<_>>(),
        "step": scene.placement.scale / 20.0,
        "rotate": turn.map(|sky| sky.rotate_degrees),
    })
}

/// What a colour picker shows for a mesh before it is touched.
fn mean_albedo(mesh: &Mesh) -> Rgb {
    let mean = |values: &[Rgb]| values.iter().sum::<Rgb>() / values.len().max(1) as f32;
    match &mesh.albedo {
        Albedo::Constant(albedo) => *albedo,
        Albedo::Vertex(values) => mean(values),
        Albedo::Texture { texture, factor, .. } => mean(&texture.pixels) * *factor,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;
    use crate::scene::Lamp;

    fn scene() -> Scene {
        let mut scene = synthetic::square();
        scene.meshes[0].name = "floor".into();
        let kind = LampKind::Point { position: Vec3::ONE, intensity: Rgb::ONE };
        scene.lamps.push(Lamp { name: "bulb".into(), kind });
        scene
    }

    #[test]
    fn edits_change_what_they_name() {
        let scene = scene();
        let text = br#"{"albedo": {"floor": [0.1, 0.2, 0.3]}, "lamps": {"bulb": {"position": [3, 2, 1]}}}"#;
        let lighting = Edit::read(text).unwrap().lighting(&scene, &Lighting::of(&scene)).unwrap();
        assert_eq!(lighting.meshes[0].paint, Paint::Plain(Rgb::new(0.1, 0.2, 0.3)));
        let there = scene.placement.to_local(DVec3::new(3.0, 2.0, 1.0));
        assert_eq!(lighting.lamps[0], LampKind::Point { position: there, intensity: Rgb::ONE });
        assert_eq!(controls(&scene, &lighting)["lamps"][0]["name"], "bulb");
    }

    #[test]
    fn edits_without_meaning_are_refused_with_a_reason() {
        let scene = scene();
        for (text, reason) in [
            (r#"{"albedo": {"flor": [0, 0, 0]}}"#, "`floor`"),
            (r#"{"albedo": {"floor": [0, 2, 0]}}"#, "floor"),
            (r#"{"albedo": {"floor": [0, 0]}}"#, "no edit"),
            (r#"{"albedo": 3}"#, "no edit"),
            (r#"{"colour": {}}"#, "unknown field"),
            (r#"{"lamps": {"bulb": {"direction": [0, 1, 0]}}}"#, "no direction"),
            (r#"{"lamps": {"bulb": {"position": [1e300, 0, 0]}}}"#, "out of reach"),
            (r#"{"rotate": 30}"#, "no image sky"),
            ("", "no edit"),
            ("\u{0}", "no edit"),
        ] {
            let refused = Edit::read(text.as_bytes()).and_then(|e| e.lighting(&scene, &Lighting::of(&scene)));
            let problem = refused.expect_err(text).to_string();
            assert!(problem.contains(reason), "{text}: {problem}");
        }
    }
}
