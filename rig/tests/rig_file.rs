//! Rig files: those that are right, and what is said of those that are not.

use std::path::Path;

use rig::{CameraConfig, ControlConfig, RigFile, RigFileError, StageConfig};

fn parse(text: &str) -> Result<RigFile, RigFileError> {
    RigFile::parse(Path::new("rig.toml"), text)
}

const WHOLE: &str = r#"
version = 1
[camera]
driver = "simulated"
[projector.display]
driver = "simulated"
[projector.control]
driver = "pjlink"
host = "192.168.0.20"
password = "secret"
input = "31"
[stage]
driver = "zaber"
port = "/dev/ttyUSB0"
axes = [
    { name = "x", unit = "mm", range = [0.0, 150.0], park = 10.0, device = 1, step = 4.96e-4 },
    { name = "turn", unit = "deg", range = [-180.0, 180.0], device = 2, step = 2.3e-4 },
]
"#;

#[test]
fn a_whole_rig_is_read() {
    let file = parse(WHOLE).unwrap();
    let Some(ControlConfig::Pjlink { port, warm_up_s, .. }) = &file.projector.control else {
        panic!("{file:?}");
    };
    assert_eq!((*port, *warm_up_s), (4352, 180.0));
    assert!(matches!(&file.stage, Some(StageConfig::Zaber { baud: 115_200, .. })));
    assert_eq!(file.stage.unwrap().axes()[1].name, "turn");
}

#[test]
fn a_key_that_is_not_known_is_named_with_those_that_are() {
    for (from, to, words) in [
        ("[camera]\n", "[camera]\nshutter = 1\n", ["shutter", "camera"]),
        ("[stage]", "[stages]", ["stages", "stage"]),
        ("host =", "hots =", ["hots", "password"]),
        ("[projector.display]", "[projector.monitor]", ["monitor", "display"]),
        ("park =", "parking =", ["parking", "park"]),
        ("driver = \"zaber\"", "driver = \"newport\"", ["newport", "grbl"]),
    ] {
        let error = parse(&WHOLE.replacen(from, to, 1)).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "{to}: {error}");
        }
        assert!(error.contains("rig.toml"), "{error}");
    }
}

#[test]
fn values_that_make_no_sense_are_named() {
    for (from, to, key) in [
        ("input = \"31\"", "input = \"hdmi\"", "projector.control.input"),
        ("input = \"31\"", "port = 0", "projector.control.port"),
        ("input = \"31\"", "warm_up_s = -1.0", "projector.control.warm_up_s"),
        ("input = \"31\"", "warm_up_s = inf", "projector.control.warm_up_s"),
        ("\"192.168.0.20\"", "\"\"", "projector.control.host"),
        ("\"secret\"", "\"two words\"", "projector.control.password"),
        ("port = \"/dev/ttyUSB0\"", "port = \"/dev/ttyUSB0\"\nbaud = 9601", "stage.baud"),
        ("\"/dev/ttyUSB0\"", "\"\"", "stage.port"),
        ("[0.0, 150.0]", "[150.0, 0.0]", "stage.axes[0].range"),
        ("[0.0, 150.0]", "[nan, 150.0]", "stage.axes[0].range"),
        ("park = 10.0", "park = 151.0", "stage.axes[0].park"),
        ("4.96e-4", "0.0", "stage.axes[0].step"),
        ("device = 2", "device = 1", "stage.axes[1].device"),
        ("device = 2", "device = 0", "stage.axes[1].device"),
        ("\"turn\"", "\"x\"", "stage.axes[1].name"),
    ] {
        assert!(WHOLE.contains(from), "{from}");
        match parse(&WHOLE.replacen(from, to, 1)) {
            Err(RigFileError::Value { key: found, .. }) => assert_eq!(found, key),
            other => panic!("{to}: {other:?}"),
        }
    }
    let secret = parse(&WHOLE.replacen("\"secret\"", "\"se cret\"", 1)).unwrap_err().to_string();
    assert!(!secret.contains("se cret"), "{secret}");
}

const CAMERA: &str = r#"
version = 1
[camera]
driver = "aravis"
name = "acA1920"
serial = "40012345"
pixel_format = "BayerRG12"
gain = 3.0
roi = [8, 16, 640, 480]
"#;

#[test]
fn a_camera_is_read_and_its_slips_are_named() {
    let file = parse(CAMERA).unwrap();
    let Some(CameraConfig::Aravis { pixel_format, gain, roi, .. }) = file.camera else {
        panic!("{:?}", file.camera);
    };
    assert_eq!(pixel_format.as_deref(), Some("BayerRG12"));
    assert_eq!((gain, roi), (Some(3.0), Some([8, 16, 640, 480])));
    for (from, to, key) in [
        ("\"acA1920\"", "\" \"", "camera.name"),
        ("\"40012345\"", "\"\"", "camera.serial"),
        ("\"BayerRG12\"", "\"12 bits\"", "camera.pixel_format"),
        ("3.0", "nan", "camera.gain"),
        ("640, 480", "0, 480", "camera.roi"),
        ("8, 16", "4294967295, 16", "camera.roi"),
    ] {
        assert!(CAMERA.contains(from), "{from}");
        match parse(&CAMERA.replacen(from, to, 1)) {
            Err(RigFileError::Value { key: found, .. }) => assert_eq!(found, key),
            other => panic!("{to}: {other:?}"),
        }
    }
    assert!(matches!(
        parse(&CAMERA.replacen("640, 480", "-1, 480", 1)),
        Err(RigFileError::Syntax { .. })
    ));
}

#[test]
fn a_video_device_is_read_and_its_slips_are_named() {
    let video = "version = 1\n[camera]\ndriver = \"v4l\"\ndevice = \"/dev/video0\"\n\
        pixel_format = \"Y10\"\nsize = [640, 480]\ngain = 2\n";
    let file = parse(video).unwrap();
    let Some(CameraConfig::V4l { device, size, gain, .. }) = file.camera else {
        panic!("{:?}", file.camera);
    };
    assert_eq!(device.as_deref(), Some("/dev/video0"));
    assert_eq!((size, gain), (Some([640, 480]), Some(2)));
    for (from, to, key) in [
        ("\"/dev/video0\"", "\" \"", "camera.device"),
        ("\"Y10\"", "\"Mono10\"", "camera.pixel_format"),
        ("640", "0", "camera.size"),
        ("480", "4294967295", "camera.size"),
    ] {
        assert!(video.contains(from), "{from}");
        match parse(&video.replacen(from, to, 1)) {
            Err(RigFileError::Value { key: found, .. }) => assert_eq!(found, key),
            other => panic!("{to}: {other:?}"),
        }
    }
}

/// Whatever is wrong, it is told with the file, the line that it stands on and its key.
#[test]
fn mistakes_are_told_by_file_line_and_key() {
    let lines = |text: &str, word: &str| {
        1 + text.lines().position(|line| line.contains(word)).unwrap_or_else(|| panic!("{word}"))
    };
    for (from, to, key, words) in [
        ("port = \"/dev/ttyUSB0\"", "port = 5", "stage.port", "expected text in quotes"),
        ("port = \"/dev/ttyUSB0\"", "port = \"/dev/x\"\nbaud = \"fast\"", "stage.baud", "\"fast\""),
        ("port = \"/dev/ttyUSB0\"", "port = \"/dev/x\"\nbaud = -1", "stage.baud", "whole number"),
        ("port = \"/dev/ttyUSB0\"", "port = \"/dev/x\"\nspeed = 1", "stage.speed", "baud"),
        (
            "input = \"31\"",
            "port = \"abc\"",
            "projector.control.port",
            "a whole number from 0 to 65535",
        ),
        ("input = \"31\"", "warm_up_s = true", "projector.control.warm_up_s", "expected a number"),
        ("host = \"192.168.0.20\"", "hots = \"x\"", "projector.control.hots", "host"),
        ("driver = \"zaber\"", "driver = 3", "stage.driver", "in quotes"),
        ("driver = \"zaber\"", "driver = \"newport\"", "stage.driver", "`grbl`"),
        ("[stage]", "[stages]", "stages", "`stage`"),
        ("device = 2", "device = \"two\"", "stage.axes[1].device", "0 to 255"),
        ("device = 2", "device = 2, speed = 1", "stage.axes[1].speed", "step"),
        ("range = [0.0, 150.0]", "range = [0.0, \"far\"]", "stage.axes[0].range[1]", "\"far\""),
        // And those that are of the right type.
        ("device = 2", "device = 0", "stage.axes[1].device", "1 to 99"),
        ("input = \"31\"", "input = \"hdmi\"", "projector.control.input", "two digits"),
        ("version = 1", "version = \"one\"", "version", "whole number"),
    ] {
        assert!(WHOLE.contains(from), "{from}");
        let text = WHOLE.replacen(from, to, 1);
        let error = parse(&text).unwrap_err().to_string();
        let line = lines(&text, to.lines().last().unwrap());
        let start = format!("rig.toml: line {line}: {key}: ");
        assert!(error.starts_with(&start) && error.contains(words), "{start}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    // What is missing is told with the part that it is missing from.
    for (without, start, words) in [
        ("host = \"192.168.0.20\"\n", "rig.toml: line 7: projector.control: ", "`host`"),
        ("driver = \"pjlink\"\n", "rig.toml: line 7: projector.control: ", "`driver`"),
        (", step = 2.3e-4", "rig.toml: line 17: stage.axes[1]: ", "`step`"),
        ("version = 1\n", "rig.toml: ", "`version`"),
    ] {
        assert!(WHOLE.contains(without), "{without}");
        let error = parse(&WHOLE.replacen(without, "", 1)).unwrap_err().to_string();
        assert!(error.starts_with(start) && error.contains(words), "{start}: {error}");
    }
    // No TOML at all.
    let error = parse("version = 1\n[camera]\ndriver = simulated\n").unwrap_err().to_string();
    assert!(error.starts_with("rig.toml: line 3: "), "{error}");
    // Parts below headers of their own.
    let places = format!("{}\n[[places]]\ntarget = \"away\"\nat = {{ x = \"far\" }}\n", WHOLE);
    let error = parse(&places).unwrap_err().to_string();
    assert!(error.contains("places[0].at.x: ") && error.contains("line 22"), "{error}");
}

#[test]
fn two_devices_cannot_share_a_port_and_a_rig_is_not_nothing() {
    let shared = r#"
        version = 1
        [projector.control]
        driver = "optoma"
        port = "/dev/ttyUSB0"
        [stage]
        driver = "grbl"
        port = "/dev/ttyUSB0"
        axes = [{ name = "x", unit = "mm", range = [0.0, 1.0], letter = "X" }]
    "#;
    let error = parse(shared).unwrap_err();
    assert!(matches!(&error, RigFileError::Value { key, .. } if key == "stage.port"), "{error}");
    assert!(matches!(parse("version = 1"), Err(RigFileError::Value { .. })));
    assert!(matches!(parse("version = 2\nnew = 1"), Err(RigFileError::Newer { found: 2, .. })));
    assert!(matches!(parse("version = "), Err(RigFileError::Syntax { .. })));
    let missing = RigFile::read(Path::new("/there/is/no/such/rig.toml"));
    assert!(matches!(missing, Err(RigFileError::Read { .. })));
}

#[test]
fn the_examples_of_the_documentation_are_right() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/devices.md");
    let text = std::fs::read_to_string(page).unwrap();
    let examples: Vec<&str> =
        text.split("```toml").skip(1).filter_map(|part| part.split("```").next()).collect();
    assert!(!examples.is_empty());
    for example in examples {
        parse(example).unwrap_or_else(|error| panic!("{error}\n{example}"));
    }
}
