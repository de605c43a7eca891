//! The Vulkan layer on a real device, under validation.

mod shaders;

use ash::vk;
use bytemuck::Zeroable;
use cairn_format::texture::mip_extent;
use cairn_format::{TextureFormat, Vertex};

use super::test_support::{allocations, close_clean, gpu};
use super::*;

/// Reproducible bytes (a linear congruential generator, Knuth's MMIX constants).
fn noise(count: usize, seed: u64) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    (0..count).map(|_| next()).collect()
}

fn buffer(gpu: &Gpu, size: u64, usage: vk::BufferUsageFlags, memory: Memory) -> Buffer {
    let desc = BufferDesc {
        name: "test",
        size,
        usage,
        memory,
    };
    Buffer::new(gpu, &desc).expect("buffer")
}

fn download(gpu: &Gpu, source: &Buffer) -> Vec<u8> {
    let size = source.size();
    let target = buffer(
        gpu,
        size,
        vk::BufferUsageFlags::TRANSFER_DST,
        Memory::Readback,
    );
    gpu.once(|commands| {
        commands.copy_buffer(source, 0, &target, 0, size);
        Ok(())
    })
    .expect("copy");
    let mut bytes = vec![0u8; size as usize];
    target.read(0, &mut bytes).expect("read");
    bytes
}

const SHADER_READ: Sync = Sync {
    stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    access: vk::AccessFlags2::MEMORY_READ,
};
const COPY_READ: Sync = Sync {
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};
const COLOR_WRITE: Sync = Sync {
    stage: vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
    access: vk::AccessFlags2::COLOR_ATTACHMENT_WRITE,
};

/// All levels, each with all layers one behind the other.
fn download_image(gpu: &Gpu, image: &Image, format: TextureFormat) -> Vec<Vec<u8>> {
    let mut levels = Vec::new();
    let mut layout = vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL;
    for level in 0..image.levels() {
        let [width, height] = image.extent().map(|size| mip_extent(size, level));
        let layer_bytes = format.level_bytes(width, height);
        let size = layer_bytes * u64::from(image.layers());
        let target = buffer(
            gpu,
            size,
            vk::BufferUsageFlags::TRANSFER_DST,
            Memory::Readback,
        );
        gpu.once(|commands| {
            commands.image_barriers(&[ImageBarrier {
                image: image.view(),
                old: layout,
                new: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                source: SHADER_READ,
                destination: COPY_READ,
            }]);
            for layer in 0..image.layers() {
                let offset = u64::from(layer) * layer_bytes;
                commands.copy_image_to_buffer(image.view(), level, layer, &target, offset);
            }
            Ok(())
        })
        .expect("copy");
        layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        let mut bytes = vec![0u8; size as usize];
        target.read(0, &mut bytes).expect("read");
        levels.push(bytes);
    }
    levels
}

#[test]
fn a_buffer_comes_back_bit_exact_and_is_checked_in_runs() {
    let Some(gpu) = gpu() else { return };
    let usage = vk::BufferUsageFlags::TRANSFER_DST | vk::BufferUsageFlags::TRANSFER_SRC;
    // Below a slot, above the ring, and no multiple of anything; records that do not divide a slot.
    for (size, record) in [(56, 56), (56 * 1001, 56), (12 * 70_003, 12), (1 << 20, 4)] {
        let bytes = noise(size, size as u64);
        let target = buffer(&gpu, size as u64, usage, Memory::Device);
        let mut uploader = Uploader::with_slot_bytes(&gpu, 100_000).expect("ring");
        let mut seen = Vec::new();
        uploader
            .upload_buffer(&target, &bytes, record, |run, offset| {
                assert_eq!(offset as usize, seen.len());
                assert_eq!(run.len() % record, 0);
                seen.extend_from_slice(run);
                Ok::<(), GpuError>(())
            })
            .expect("upload");
        let stats = uploader.finish().expect("finish");
        assert_eq!(stats.bytes, size as u64);
        assert!(u64::from(stats.submissions) >= stats.bytes / 100_000);
        assert!(seen == bytes, "{size} bytes were checked wrongly");
        assert!(download(&gpu, &target) == bytes, "{size} bytes differ");
    }
    close_clean(gpu);
}

#[test]
fn a_failing_check_stops_the_upload() {
    let Some(gpu) = gpu() else { return };
    let target = buffer(
        &gpu,
        1 << 20,
        vk::BufferUsageFlags::TRANSFER_DST,
        Memory::Device,
    );
    let mut uploader = Uploader::with_slot_bytes(&gpu, 64 << 10).expect("ring");
    let bytes = vec![0; 1 << 20];
    let mut runs = 0;
    let result = uploader.upload_buffer(&target, &bytes, 4, |_, offset| {
        runs += 1;
        if offset < 300_000 {
            Ok(())
        } else {
            Err(GpuError::DeviceLost)
        }
    });
    assert!(matches!(result, Err(GpuError::DeviceLost)));
    assert!(runs < 16, "the upload went on for {runs} runs");
    drop(target);
    drop(uploader);
    gpu.wait_idle().expect("idle");
    close_clean(gpu);
}

#[test]
fn a_record_larger_than_a_slot_is_a_typed_error() {
    let Some(gpu) = gpu() else { return };
    let target = buffer(&gpu, 64, vk::BufferUsageFlags::TRANSFER_DST, Memory::Device);
    let mut uploader = Uploader::with_slot_bytes(&gpu, 32).expect("ring");
    let result = uploader.upload_buffer(&target, &[0; 64], 64, |_, _| Ok::<(), GpuError>(()));
    assert!(matches!(
        result,
        Err(GpuError::Limit {
            needed: 64,
            limit: 32,
            ..
        })
    ));
    close_clean(gpu);
}

fn image_round_trip(gpu: &Gpu, format: TextureFormat, desc: &ImageDesc<'_>, slot_bytes: u64) {
    let image = Image::new(gpu, desc).expect("image");
    let levels: Vec<Vec<u8>> = (0..desc.levels)
        .map(|level| {
            let [width, height] = desc.extent.map(|size| mip_extent(size, level));
            let bytes = format.level_bytes(width, height) * u64::from(desc.layers);
            noise(bytes as usize, u64::from(level) + 1)
        })
        .collect();
    let mut uploader = Uploader::with_slot_bytes(gpu, slot_bytes).expect("ring");
    uploader
        .upload_image(&image, format, levels.iter().map(Vec::as_slice))
        .expect("upload");
    uploader.finish().expect("finish");
    assert!(
        download_image(gpu, &image, format) == levels,
        "{desc:?} differs"
    );
}

#[test]
fn images_come_back_bit_exact() {
    let Some(gpu) = gpu() else { return };
    let usage = vk::ImageUsageFlags::SAMPLED
        | vk::ImageUsageFlags::TRANSFER_DST
        | vk::ImageUsageFlags::TRANSFER_SRC;
    let desc = ImageDesc {
        name: "test",
        format: vk::Format::R8G8B8A8_UNORM,
        extent: [1, 1],
        levels: 1,
        layers: 1,
        cube: false,
        array: false,
        samples: 1,
        usage,
    };
    image_round_trip(&gpu, TextureFormat::Rgba8Unorm, &desc, 1 << 20);
    // Neither width nor height a multiple of a block, a full chain, more than the whole ring.
    let bc7 = ImageDesc {
        format: vk::Format::BC7_UNORM_BLOCK,
        extent: [301, 199],
        levels: 9,
        ..desc
    };
    image_round_trip(&gpu, TextureFormat::Bc7Unorm, &bc7, 8 << 10);
    let bc4 = ImageDesc {
        format: vk::Format::BC4_UNORM_BLOCK,
        ..bc7
    };
    image_round_trip(&gpu, TextureFormat::Bc4Unorm, &bc4, 1 << 20);
    let cube = ImageDesc {
        format: vk::Format::BC6H_UFLOAT_BLOCK,
        extent: [64, 64],
        levels: 7,
        layers: 6,
        cube: true,
        array: false,
        samples: 1,
        ..desc
    };
    image_round_trip(&gpu, TextureFormat::Bc6hUfloat, &cube, 5000);
    image_round_trip(&gpu, TextureFormat::Bc6hUfloat, &cube, 1 << 20);
    close_clean(gpu);
}

/// Levels go from the caller's bytes to staging memory: a copy between would be an allocation a level.
#[test]
fn levels_are_copied_once() {
    let Some(gpu) = gpu() else { return };
    let upload = |levels: u32| {
        let desc = ImageDesc {
            name: "chain",
            format: vk::Format::BC7_UNORM_BLOCK,
            extent: [256, 256],
            levels,
            layers: 1,
            cube: false,
            array: false,
            samples: 1,
            usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
        };
        let image = Image::new(&gpu, &desc).expect("image");
        let format = TextureFormat::Bc7Unorm;
        let bytes = noise(format.level_bytes(256, 256) as usize, 1);
        let chain = (0..levels).map(|level| {
            let size = mip_extent(256, level);
            &bytes[..format.level_bytes(size, size) as usize]
        });
        let mut uploader = Uploader::new(&gpu).expect("ring");
        let before = allocations();
        uploader
            .upload_image(&image, format, chain)
            .expect("upload");
        let made = allocations() - before;
        uploader.finish().expect("finish");
        made
    };
    upload(1);
    assert_eq!(upload(9), upload(1));
    close_clean(gpu);
}

#[test]
fn an_impossible_image_is_a_typed_error() {
    let Some(gpu) = gpu() else { return };
    let desc = ImageDesc {
        name: "far too wide",
        format: vk::Format::R8G8B8A8_UNORM,
        extent: [1 << 20, 1],
        levels: 1,
        layers: 1,
        cube: false,
        array: false,
        samples: 1,
        usage: vk::ImageUsageFlags::SAMPLED,
    };
    match Image::new(&gpu, &desc).err() {
        Some(GpuError::Limit { what, needed, .. }) => {
            assert!(what.contains("far too wide"), "{what}");
            assert_eq!(needed, 1 << 20);
        }
        other => panic!("{other:?}"),
    }
    // Compressed images are no render targets anywhere.
    let target = ImageDesc {
        format: vk::Format::BC7_UNORM_BLOCK,
        extent: [4, 4],
        usage: vk::ImageUsageFlags::COLOR_ATTACHMENT,
        ..desc
    };
    assert!(matches!(
        Image::new(&gpu, &target),
        Err(GpuError::Format { .. })
    ));
    close_clean(gpu);
}

#[test]
fn an_unknown_device_name_is_a_typed_error() {
    if gpu().is_none() {
        return;
    }
    let options = GpuOptions {
        validation: false,
        device: Some("no such device".into()),
        ..GpuOptions::default()
    };
    match Gpu::new(&options).err() {
        Some(GpuError::NoDevice(text)) => assert!(text.contains("no such device"), "{text}"),
        other => panic!("{other:?}"),
    }
}

const SIZE: u32 = 16;
const CLEAR: [u8; 4] = [0, 0, 255, 255];
const DRAWN: [u8; 4] = [42, 0, 0, 255];

/// Draws the upper left half of clip space (Y up), counter-clockwise or not.
fn draw_triangle(gpu: &Gpu, clockwise: bool) -> (Vec<[u8; 4]>, Vec<PassTime>) {
    let layouts = Layouts::new(gpu, 0, 0).expect("layouts");
    let format = vk::Format::R8G8B8A8_UNORM;
    let desc = GraphicsPipelineDesc {
        name: "triangle",
        vertex: Shader {
            spirv: shaders::VERTEX,
            constants: &[],
        },
        fragment: Some(Shader {
            spirv: shaders::FRAGMENT,
            constants: &[(7, 40)],
        }),
        input: VertexInput::Scene,
        colors: &[ColorTarget {
            format,
            blend: Blend::None,
        }],
        depth: Some(DepthState {
            format: vk::Format::D32_SFLOAT,
            compare: vk::CompareOp::GREATER,
            write: true,
        }),
        samples: 1,
        depth_bias: false,
    };
    let pipeline = GraphicsPipeline::new(gpu, &layouts, &desc).expect("pipeline");
    let image = |name, format, usage| {
        let desc = ImageDesc {
            name,
            format,
            extent: [SIZE; 2],
            levels: 1,
            layers: 1,
            cube: false,
            array: false,
            samples: 1,
            usage,
        };
        Image::new(gpu, &desc).expect("image")
    };
    let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC;
    let color = image("color", format, usage);
    let usage = vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT;
    let depth = image("depth", vk::Format::D32_SFLOAT, usage);

    let corners = [[-1.0, 1.0, 0.5], [-1.0, -1.0, 0.5], [1.0, 1.0, 0.5]];
    let vertices = corners.map(|position| Vertex {
        position,
        ..Vertex::zeroed()
    });
    let order: [u32; 3] = if clockwise { [0, 2, 1] } else { [0, 1, 2] };
    let upload = |bytes: &[u8], usage| {
        let mut buffer = buffer(gpu, bytes.len() as u64, usage, Memory::Upload);
        buffer.write(0, bytes).expect("write");
        buffer
    };
    let vertex_usage = vk::BufferUsageFlags::VERTEX_BUFFER;
    let vertices = upload(bytemuck::cast_slice(&vertices), vertex_usage);
    let instances = upload(bytemuck::cast_slice(&[9u32, 2]), vertex_usage);
    let indices = upload(
        bytemuck::cast_slice(&order),
        vk::BufferUsageFlags::INDEX_BUFFER,
    );
    let size = u64::from(SIZE * SIZE * 4);
    let pixels = buffer(
        gpu,
        size,
        vk::BufferUsageFlags::TRANSFER_DST,
        Memory::Readback,
    );

    let mut frames = Frames::new(gpu).expect("frames");
    for _ in 0..2 * FRAMES_IN_FLIGHT + 1 {
        let mut commands = frames.begin().expect("begin");
        commands.pass_begin(c"triangle");
        begin_triangle(&mut commands, &color, &depth);
        commands.bind_graphics(&pipeline);
        commands.bind_vertex_buffer(0, &vertices, 0);
        commands.bind_vertex_buffer(1, &instances, 0);
        commands.bind_index_buffer(&indices);
        commands.draw_indexed(3, 1, 0, 0, 1);
        commands.end_rendering();
        commands.pass_end();
        commands.image_barriers(&[ImageBarrier {
            image: color.view(),
            old: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            new: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            source: COLOR_WRITE,
            destination: COPY_READ,
        }]);
        commands.copy_image_to_buffer(color.view(), 0, 0, &pixels, 0);
        frames.submit(commands).expect("submit");
    }
    frames.collect().expect("collect");
    let mut texels = vec![[0u8; 4]; (SIZE * SIZE) as usize];
    pixels.read(0, &mut texels).expect("read");
    (texels, frames.timings().to_vec())
}

fn begin_triangle(commands: &mut Commands, color: &Image, depth: &Image) {
    let depth_write = Sync {
        stage: vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS
            | vk::PipelineStageFlags2::LATE_FRAGMENT_TESTS,
        access: vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ
            | vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE,
    };
    // The frame before copies from the image until its copy stage has finished.
    let before = Sync {
        stage: vk::PipelineStageFlags2::COPY | vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
        access: vk::AccessFlags2::COLOR_ATTACHMENT_WRITE | vk::AccessFlags2::TRANSFER_WRITE,
    };
    commands.image_barriers(&[
        ImageBarrier {
            image: color.view(),
            old: vk::ImageLayout::UNDEFINED,
            new: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            source: before,
            destination: COLOR_WRITE,
        },
        ImageBarrier {
            image: depth.view(),
            old: vk::ImageLayout::UNDEFINED,
            new: vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL,
            source: depth_write,
            destination: depth_write,
        },
    ]);
    let colors = [ColorAttachment {
        image: color.view(),
        load: Load::Clear([0.0, 0.0, 1.0, 1.0]),
        store: true,
    }];
    let depth = DepthAttachment {
        image: depth.view(),
        load: Load::Clear(0.0),
        store: false,
    };
    commands.begin_rendering([SIZE; 2], &colors, Some(depth));
    commands.set_viewport([SIZE; 2], true);
    commands.set_scissor([SIZE; 2]);
    commands.set_cull_mode(vk::CullModeFlags::BACK);
    commands.set_front_face(vk::FrontFace::COUNTER_CLOCKWISE);
}

#[test]
fn a_counter_clockwise_triangle_is_drawn_where_y_points_up() {
    let Some(gpu) = gpu() else { return };
    let (texels, times) = draw_triangle(&gpu, false);
    for (index, texel) in (0..).zip(&texels) {
        let (x, y) = (index % SIZE, index / SIZE);
        // The diagonal's own pixels may fall to either side.
        if x + y + 1 != SIZE {
            let expected = if x + y + 1 < SIZE { DRAWN } else { CLEAR };
            assert_eq!(*texel, expected, "at {x}, {y}");
        }
    }
    if gpu.limits().timestamp_compute_and_graphics == vk::TRUE {
        assert_eq!(times.len(), 1);
        assert_eq!(times[0].name, c"triangle");
        assert!(
            (0.0..10_000.0).contains(&times[0].milliseconds),
            "{times:?}"
        );
    }
    close_clean(gpu);
}

#[test]
fn a_clockwise_triangle_is_culled() {
    let Some(gpu) = gpu() else { return };
    let (texels, _) = draw_triangle(&gpu, true);
    assert!(texels.iter().all(|texel| *texel == CLEAR));
    close_clean(gpu);
}

#[test]
fn a_compute_shader_writes_what_its_push_constant_says() {
    let Some(gpu) = gpu() else { return };
    let layouts = Layouts::new(&gpu, 3, 0).expect("layouts");
    let shader = Shader {
        spirv: shaders::COMPUTE,
        constants: &[],
    };
    let pipeline = ComputePipeline::new(&gpu, &layouts, "multiply", &shader).expect("pipeline");
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
    let values = buffer(&gpu, 64 * 4, usage, Memory::Readback);
    let mut set = layouts.allocate(SetIndex::Frame, "frame").expect("set");
    set.write_buffer(2, &values).expect("write");
    let uniform = buffer(
        &gpu,
        16,
        vk::BufferUsageFlags::UNIFORM_BUFFER,
        Memory::Upload,
    );
    set.write_buffer(0, &uniform).expect("write");
    set.write_buffer(1, &values).expect("write");
    set.write_buffer(3, &values).expect("write");
    gpu.once(|commands| {
        commands.bind_compute(&pipeline);
        commands.bind_sets(&layouts, vk::PipelineBindPoint::COMPUTE, &[&set]);
        commands.push_constants(&layouts, &7u32);
        commands.dispatch([16, 1, 1]);
        commands.memory_barrier(
            Sync {
                stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
                access: vk::AccessFlags2::SHADER_STORAGE_WRITE,
            },
            Sync {
                stage: vk::PipelineStageFlags2::HOST,
                access: vk::AccessFlags2::HOST_READ,
            },
        );
        Ok(())
    })
    .expect("run");
    let mut out = [0u32; 64];
    values.read(0, &mut out).expect("read");
    assert!((0..).zip(out).all(|(index, value)| value == index * 7u32));
    close_clean(gpu);
}

#[test]
fn objects_may_be_dropped_while_a_frame_uses_them() {
    let Some(gpu) = gpu() else { return };
    let mut frames = Frames::new(&gpu).expect("frames");
    let usage = vk::BufferUsageFlags::TRANSFER_DST | vk::BufferUsageFlags::TRANSFER_SRC;
    for _ in 0..4 * FRAMES_IN_FLIGHT {
        let mut commands = frames.begin().expect("begin");
        let source = buffer(&gpu, 1 << 20, usage, Memory::Device);
        let target = buffer(&gpu, 1 << 20, usage, Memory::Device);
        commands.copy_buffer(&source, 0, &target, 0, 1 << 20);
        drop(source);
        frames.submit(commands).expect("submit");
    }
    // A recording that is never submitted.
    drop(frames.begin().expect("begin"));
    drop(frames);
    close_clean(gpu);
}

#[test]
fn the_validation_layer_really_validates() {
    let Some(gpu) = gpu() else { return };
    let target = buffer(
        &gpu,
        16,
        vk::BufferUsageFlags::VERTEX_BUFFER,
        Memory::Device,
    );
    gpu.once(|commands| {
        commands.copy_buffer(&target, 0, &target, 8, 8);
        Ok(())
    })
    .expect("once");
    let messages = gpu.validation_messages();
    assert!(
        messages.iter().any(|message| message.contains("VUID")),
        "a copy between buffers without transfer usage was not reported: {messages:?}"
    );
}
