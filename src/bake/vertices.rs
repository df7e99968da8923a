//! Light at the vertices of meshes that stay in their files: found chunk by chunk, read back in the order of the file.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use crate::archive::{Archive, Digests, Pause, Storage, Tag, Writer};
use crate::bake::model::Model;
use crate::detail::Detail;
use crate::error::{Error, Result};
use crate::geometry::{SurfacePoint, morton, octahedral};
use crate::light::Rgb;
use crate::output::Advance;
use crate::output::exposure;
use crate::output::ply::{self, Lights};
use crate::output::vertices::VertexLight;
use crate::scene::materials::LIMIT;
use crate::scene::{Albedo, Mesh};
use crate::solve::Irradiance;

/// Vertices asked together: enough of them share rows, and they take less than a second.
const TOGETHER: usize = 1 << 17;

/// The kind of file that holds answers on their way.
const KIND: Tag = Tag::new("answers");

/// The light of one vertex, as it is kept.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Answer {
    irradiance: [f32; 3],
    /// In 65,535ths.
    ambient_occlusion: u16,
    /// A half float.
    error: u16,
}

impl Answer {
    fn of(light: &Irradiance) -> Self {
        let sound = |value: f32| if value.is_finite() { value } else { 0.0 };
        Self {
            irradiance: light.total().to_array().map(sound),
            ambient_occlusion: (sound(light.sky_visibility).clamp(0.0, 1.0) * 65_535.0).round() as u16,
            error: f16::from_f32(sound(light.error)).to_bits(),
        }
    }

    fn light(&self, (albedo, exitance): (Rgb, Rgb)) -> VertexLight {
        let irradiance = Rgb::from_array(self.irradiance);
        VertexLight {
            radiosity: exitance + albedo * irradiance,
            irradiance,
            ambient_occlusion: f32::from(self.ambient_occlusion) / 65_535.0,
            error: f16::from_bits(self.error).to_f32(),
        }
    }
}

/// Where answers are kept until the file is written.
pub struct Workshop<'a> {
    /// What changes the disk.
    pub storage: &'a Arc<dyn Storage>,
    /// A folder for them.
    pub folder: &'a Path,
    /// What they are made from: answers of an earlier run are taken up if it is the same.
    pub digests: Digests,
    /// Asked between pieces of work.
    pub pause: Pause<'a>,
}

/// Writes a streamed mesh of a model with the light of its vertices to `path`, its rows as they are in its file.
///
/// One pass over the chunks, in which each is answered for by itself, and one over the file. Memory does not grow with the
/// mesh. `advance` counts vertices, once when they are answered for.
///
/// # Errors
/// As [`ply::export`]; the pause's; those of reading the chunks.
pub fn export(
    (path, model, number): (&Path, &Model, usize),
    workshop: &Workshop<'_>,
    advance: &Advance<'_>,
) -> Result<()> {
    let (mesh, detail) = &model.details[number];
    let name = workshop.folder.join(format!("answers-{number}.glow"));
    let answers = answer(model, detail, (&name, workshop), advance)?;
    let lights = InOrder::new(&model.scene.meshes[*mesh], detail, &answers)?;
    let paused = |_| (workshop.pause)();
    ply::rewrite((path, &model.scene.meshes[*mesh].file), &lights, shown_at(model), &paused)?;
    drop(lights);
    drop(answers);
    workshop.storage.remove(&name).map_err(|e| Error::io(&name, "removing", e))
}

/// The exposure at which the sites' light shows well.
fn shown_at(model: &Model) -> f32 {
    let light = model.solution.radiosity.iter().zip(&model.sites.areas);
    exposure::automatic(light.map(|(radiosity, &area)| (exposure::luminance(*radiosity), area)))
}

/// Answers for all chunks, those of an earlier run taken up.
fn answer(
    model: &Model,
    detail: &Detail,
    (name, workshop): (&Path, &Workshop<'_>),
    advance: &Advance<'_>,
) -> Result<Archive> {
    let done = |archive: &Archive| archive.kind() == KIND && archive.digests() == workshop.digests;
    if let Some(archive) = Archive::open(name).ok().filter(done) {
        return Ok(archive);
    }
    let storage = || Arc::clone(workshop.storage);
    let begun = Writer::resume_in(storage(), name, KIND, workshop.digests);
    let mut writer = match begun {
        Ok((writer, _)) => writer,
        Err(Error::JobDiffers { .. }) => Writer::create_in(storage(), name, KIND, workshop.digests)?,
        Err(other) => return Err(other),
    };
    let mut first = writer.entries().last().map_or(0, |entry| entry.range().end);
    advance(first)?;
    for chunk in writer.entries().len()..detail.chunk_count() {
        let answers = answer_chunk(model, detail, chunk, workshop.pause)?;
        let range = first..first + answers.len() as u64;
        first = range.end;
        writer.append(KIND, range, &answers)?;
        writer.checkpoint()?;
        advance(answers.len() as u64)?;
    }
    writer.finish(&[])?;
    Archive::open(name)
}

/// The light of a chunk's vertices, in their order there.
fn answer_chunk(model: &Model, detail: &Detail, chunk: usize, pause: Pause<'_>) -> Result<Vec<Answer>> {
    let (points, normals) = (detail.points(chunk)?, detail.normals(chunk)?);
    let field = model.field();
    // Along a curve, so that those that are asked together lie together.
    let corner = Vec3::splat(-0.5);
    let mut order: Vec<(u64, u32)> = (0..points.len() as u32)
        .into_par_iter()
        .filter(|&k| normals[k as usize] != octahedral::NONE && points[k as usize].is_finite())
        .map(|k| (morton::code(points[k as usize], corner, detail.cell()), k))
        .collect();
    order.par_sort_unstable();
    let mut answers = vec![Answer::zeroed(); points.len()];
    for batch in order.chunks(TOGETHER) {
        pause()?;
        let point = |&(_, k): &(u64, u32)| SurfacePoint {
            position: points[k as usize],
            normal: octahedral::decode(normals[k as usize]),
        };
        let asked: Vec<SurfacePoint> = batch.iter().map(point).collect();
        let lights = field.evaluate_crowd(&asked);
        batch.iter().zip(&lights).for_each(|((_, k), light)| answers[*k as usize] = Answer::of(light));
    }
    model.bvh.sound()?;
    Ok(answers)
}

/// Answers as the file's order asks for them.
struct InOrder<'a> {
    mesh: &'a Mesh,
    count: usize,
    chunks: Vec<Known<'a>>,
}

/// One chunk's vertices.
struct Known<'a> {
    ids: &'a [u32],
    colours: Option<&'a [[f16; 3]]>,
    answers: &'a [Answer],
}

impl<'a> InOrder<'a> {
    fn new(mesh: &'a Mesh, detail: &'a Detail, answers: &'a Archive) -> Result<Self> {
        let known = |(chunk, block): (usize, crate::archive::Block<'a>)| {
            let known =
                Known { ids: detail.ids(chunk)?, colours: detail.colours(chunk)?, answers: block.array()? };
            if known.ids.len() == known.answers.len() {
                return Ok(known);
            }
            let (file, place) = (answers.file().to_owned(), format!("answers of chunk {chunk}"));
            let problem = format!("expected {}, got {}", known.ids.len(), known.answers.len());
            Err(Error::Damaged { file, place, problem })
        };
        let chunks = answers.blocks(KIND).enumerate().map(known).collect::<Result<_>>()?;
        Ok(Self { mesh, count: detail.vertices() as usize, chunks })
    }

    /// Albedo and exitance of a chunk's vertex.
    fn material(&self, known: &Known<'_>, k: usize) -> (Rgb, Rgb) {
        let albedo = match (&self.mesh.albedo, known.colours) {
            (Albedo::Constant(albedo), _) => *albedo,
            (_, Some(colours)) => {
                Rgb::from_array(colours[k].map(f16::to_f32)).clamp(Rgb::ZERO, Rgb::splat(LIMIT))
            }
            _ => Rgb::ZERO,
        };
        (albedo, self.mesh.radiance * std::f32::consts::PI)
    }
}

impl Lights for InOrder<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn light(&self, range: Range<usize>) -> Result<Vec<VertexLight>> {
        let mut lights = vec![VertexLight::default(); range.len()];
        for known in &self.chunks {
            let from = known.ids.partition_point(|&id| (id as usize) < range.start);
            let own = known.ids[from..].iter().take_while(|&&id| (id as usize) < range.end);
            for (k, &id) in own.enumerate() {
                let material = self.material(known, from + k);
                lights[id as usize - range.start] = known.answers[from + k].light(material);
            }
        }
        Ok(lights)
    }
}
