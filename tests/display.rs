//! The projector's window on real X servers: every pixel, and what comes in between.
#![cfg(all(feature = "display", target_os = "linux"))]

#[path = "common/screens.rs"]
mod screens;

use rig::devices::display::{Display, WindowProgram};
use rig::devices::list_monitors;
use rig::{Axis, Chessboard, DeviceError, DeviceErrorKind, Pattern, Projector, ProjectorImage};
use screens::screenshot;
use simulator::devices::VirtualScreen;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use x11rb::connection::Connection;
use x11rb::protocol::randr::ConnectionExt as _;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt, CreateWindowAux, Window, WindowClass};
use x11rb::rust_connection::RustConnection;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 400;

fn program() -> WindowProgram {
    WindowProgram::at(Path::new(env!("CARGO_BIN_EXE_diaphane")))
}

/// The projector, on the monitor of that name or the first one. There is no electronics to wait for.
fn open(server: &str, monitor: Option<&str>) -> Display {
    let first = list_monitors(Some(server)).unwrap()[0].name.clone();
    let monitor = monitor.unwrap_or(&first);
    Display::open(Some(server), monitor, Duration::ZERO, &program()).unwrap()
}

/// Pictures that no scaling, smoothing, colour space or byte order would leave as they are: all
/// levels, single pixels, and what a capture shows.
fn pictures(width: u32, height: u32) -> Vec<(&'static str, ProjectorImage)> {
    let of = |pattern: Pattern| {
        // A face that lies askew, so that edges run through pixels.
        let face = move |[x, y]: [f64; 2]| {
            let (x, y) = (x / f64::from(width), y / f64::from(height));
            Some([1.1 * x - 0.1 * y, 0.07 * x + y - 0.02])
        };
        pattern.render(width, height, Some(&face)).unwrap()
    };
    let drawn = |level: &dyn Fn(u32, u32) -> u8| {
        let row = |y| (0..width).map(move |x| level(x, y));
        ProjectorImage { width, height, data: (0..height).flat_map(row).collect() }
    };
    let board = Chessboard { columns: 9, rows: 5, square_px: 37, x0: 31, y0: 17 };
    vec![
        ("region", of(Pattern::region(4, 4, 6))),
        ("code", of(Pattern::GrayCode { axis: Axis::X, bit: 0, inverse: false })),
        ("rows", of(Pattern::GrayCode { axis: Axis::Y, bit: 3, inverse: true })),
        ("wave", of(Pattern::Phase { axis: Axis::X, period_px: 31, step: 1, steps: 4 })),
        ("board", of(Pattern::Chessboard(board))),
        ("single pixels", drawn(&|x, y| if (x + y) % 2 == 0 { 255 } else { 0 })),
        ("every level", drawn(&|x, y| (x + 7 * y) as u8)),
        (
            "corners",
            drawn(&|x, y| {
                let edge = |at, end| at == 0 || at + 1 == end;
                if edge(x, width) && edge(y, height) { 200 } else { 1 }
            }),
        ),
        ("white", of(Pattern::White)),
        ("black", of(Pattern::Black)),
    ]
}

#[test]
fn the_screen_is_the_picture_pixel_by_pixel() {
    let screen = VirtualScreen::start(WIDTH, HEIGHT).expect("Xvfb");
    let server = screen.server();
    let mut display = open(server, None);
    assert_eq!((display.info().width, display.info().height), (WIDTH, HEIGHT));
    for (name, image) in pictures(WIDTH, HEIGHT) {
        display.show(&image).unwrap();
        assert_eq!(screenshot(server).wrong(&image, 0, 0), 0, "{name}: wrong pixels");
        display.still_shows().unwrap();
    }
    // The comparison sees a single level of a single pixel.
    let (_, mut image) = pictures(WIDTH, HEIGHT).remove(6);
    display.show(&image).unwrap();
    image.data[12_345] ^= 1;
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 1);
    let small = Pattern::White.render(WIDTH / 2, HEIGHT, None).unwrap();
    assert_eq!(display.show(&small).unwrap_err().kind(), DeviceErrorKind::Unsupported);
    display.park().unwrap();
    assert!(Desk::new(server).windows().is_empty());
}

/// Somebody else at the server.
struct Desk {
    connection: RustConnection,
    root: Window,
}

impl Desk {
    fn new(server: &str) -> Self {
        let (connection, screen) = x11rb::connect(Some(server)).unwrap();
        let root = connection.setup().roots[screen].root;
        Self { connection, root }
    }

    /// The projector's windows, by their title.
    fn windows(&self) -> Vec<Window> {
        let tree = self.connection.query_tree(self.root).unwrap().reply().unwrap();
        let ours = |window: &Window| {
            let (name, text) = (AtomEnum::WM_NAME, AtomEnum::STRING);
            let title = self.connection.get_property(false, *window, name, text, 0, 100).unwrap();
            title.reply().is_ok_and(|title| title.value == b"diaphane projector")
        };
        tree.children.into_iter().filter(ours).collect()
    }

    /// The projector's window, once there is one.
    fn window(&self) -> Window {
        let windows = self.windows();
        assert_eq!(windows.len(), 1);
        windows[0]
    }

    /// A note that pops up above everything, and may go again.
    fn pop_up(&self, x: i16, y: i16) -> Window {
        let note = self.connection.generate_id().unwrap();
        let attributes = CreateWindowAux::new().override_redirect(1).background_pixel(0x00ff_0000);
        let (depth, visual) = (x11rb::COPY_FROM_PARENT as u8, x11rb::COPY_FROM_PARENT);
        let class = WindowClass::INPUT_OUTPUT;
        self.connection
            .create_window(depth, note, self.root, x, y, 60, 40, 0, class, visual, &attributes)
            .unwrap();
        self.connection.map_window(note).unwrap();
        self.settle();
        note
    }

    /// What a monitor makes of the levels of blue.
    fn blue(&self, monitor: &str) -> Vec<u16> {
        let screen = &self.connection;
        let all = screen.randr_get_screen_resources_current(self.root).unwrap().reply().unwrap();
        let mut outputs = all.outputs.iter().map(|&output| {
            screen.randr_get_output_info(output, all.config_timestamp).unwrap().reply().unwrap()
        });
        let output = outputs.find(|output| output.name == monitor.as_bytes()).unwrap();
        screen.randr_get_crtc_gamma(output.crtc).unwrap().reply().unwrap().blue
    }

    fn settle(&self) {
        self.connection.get_input_focus().unwrap().reply().unwrap();
    }
}

#[test]
fn what_covers_the_picture_is_noticed_and_put_below() {
    let screen = VirtualScreen::start(WIDTH, HEIGHT).expect("Xvfb");
    let server = screen.server();
    let mut display = open(server, None);
    let desk = Desk::new(server);
    let image = pictures(WIDTH, HEIGHT).remove(3).1;
    display.show(&image).unwrap();
    display.still_shows().unwrap();
    let note = desk.pop_up(100, 50);
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 60 * 40);
    // Whoever exposed meanwhile has to do so again.
    assert_eq!(display.still_shows().unwrap_err().kind(), DeviceErrorKind::Busy);
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 0);
    display.still_shows().unwrap();
    // One that came and went between two questions counts too, and leaves no hole.
    desk.connection.destroy_window(note).unwrap();
    let note = desk.pop_up(300, 200);
    desk.connection.destroy_window(note).unwrap();
    desk.settle();
    assert_eq!(display.still_shows().unwrap_err().kind(), DeviceErrorKind::Busy);
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 0);
    // What is there before a picture is shown ends up below it.
    desk.pop_up(10, 10);
    display.show(&image).unwrap();
    display.still_shows().unwrap();
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 0);
}

#[test]
fn a_window_that_is_lost_is_told_and_opens_again() {
    let screen = VirtualScreen::start(WIDTH, HEIGHT).expect("Xvfb");
    let server = screen.server();
    let mut display = open(server, None);
    let desk = Desk::new(server);
    let image = pictures(WIDTH, HEIGHT).remove(4).1;
    let gone = |outcome: Result<(), DeviceError>| {
        assert_eq!(outcome.unwrap_err().kind(), DeviceErrorKind::Disconnected);
    };
    // As xkill does it: the window's connection is cut.
    display.show(&image).unwrap();
    desk.connection.kill_client(desk.window()).unwrap();
    desk.settle();
    gone(display.still_shows());
    // No new window stands where the exposed frame was lit by none.
    gone(display.still_shows());
    display.show(&image).unwrap();
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 0);
    // The window alone.
    desk.connection.destroy_window(desk.window()).unwrap();
    desk.settle();
    gone(display.show(&image));
    display.show(&image).unwrap();
    display.still_shows().unwrap();
    assert_eq!(screenshot(server).wrong(&image, 0, 0), 0);
    // The whole server.
    let name = server.to_owned();
    drop(screen);
    gone(display.show(&image));
    let error = display.show(&image).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    assert!(error.to_string().contains(&name), "{error}");
}

/// Whoever kills a capture finds no window left over the desktop.
#[test]
fn a_window_goes_when_nobody_gives_it_orders_any_more() {
    let screen = VirtualScreen::start(WIDTH, HEIGHT).expect("Xvfb");
    let monitor = list_monitors(Some(screen.server())).unwrap()[0].name.clone();
    let mut window = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["projector-window", &monitor])
        .env("DISPLAY", screen.server())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    BufReader::new(window.stdout.take().unwrap()).read_line(&mut told).unwrap();
    assert_eq!(told, "\"Done\"\n");
    let desk = Desk::new(screen.server());
    assert_eq!(desk.windows().len(), 1);
    drop(window.stdin.take());
    assert!(window.wait().unwrap().success());
    assert!(desk.windows().is_empty());
}

#[test]
fn a_monitor_that_is_not_there_is_told_with_those_that_are() {
    let screen = VirtualScreen::start(WIDTH, HEIGHT).expect("Xvfb");
    let server = screen.server();
    let open = |server: &str, monitor: &str| {
        Display::open(Some(server), monitor, Duration::ZERO, &program()).map(drop).unwrap_err()
    };
    let error = open(server, "HDMI-9");
    assert!(matches!(error, DeviceError::NoneSuch { .. }), "{error:?}");
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    let first = &list_monitors(Some(server)).unwrap()[0];
    let told = format!("{} (640 x 400", first.name);
    assert!(error.to_string().contains(&told), "{error}");
    assert!(error.to_string().contains("HDMI-9"), "{error}");
    let error = open(":4711", "HDMI-9");
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    assert!(error.to_string().contains(":4711"), "{error}");
}

/// Ended when it is dropped.
struct Xorg {
    child: Child,
    server: String,
    _folder: tempfile::TempDir,
}

impl Drop for Xorg {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Xorg with two monitors in memory, side by side, the left one 800 x 600 and the other of our size.
fn two_monitors() -> Option<Xorg> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("xorg.conf");
    let log = folder.path().join("log");
    let text = r#"
        Section "Device"
            Identifier "memory"
            Driver "dummy"
            VideoRam 65536
        EndSection
        Section "Screen"
            Identifier "screen"
            Device "memory"
            DefaultDepth 24
            SubSection "Display"
                Depth 24
                Virtual 1440 600
            EndSubSection
        EndSection
        Section "ServerFlags"
            Option "AutoAddDevices" "false"
            Option "DontVTSwitch" "true"
        EndSection
    "#;
    std::fs::write(&file, text).unwrap();
    let arguments = ["-noreset", "-novtswitch", "-sharevts", "-nolisten", "tcp", "-config"];
    let (file, log) = (file.to_str()?, log.to_str()?);
    let mut child = Command::new("Xorg")
        .args(["-displayfd", "1"])
        .args(arguments)
        .args([file, "-logfile", log])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .ok()?;
    let output = child.stdout.take();
    let mut xorg = Xorg { child, server: String::new(), _folder: folder };
    let mut number = String::new();
    // It prints the number, or ends.
    BufReader::new(output?).read_line(&mut number).ok()?;
    xorg.server = format!(":{}", number.trim());
    let server = &xorg.server;
    let xrandr = |arguments: &[&str]| {
        let status = Command::new("xrandr")
            .args(["--display", server])
            .args(arguments)
            .stderr(Stdio::null())
            .status();
        status.is_ok_and(|status| status.success()).then_some(())
    };
    // Pixel clock (MHz), then columns and lines: shown, of the pulse, in all.
    let left = ["38.25", "800", "832", "912", "1024", "600", "603", "607", "624"];
    let right = ["20.00", "640", "664", "728", "816", "400", "403", "409", "417"];
    for (mode, clock, output, place) in [
        ("left", left, "DUMMY0", &["--pos", "0x0"][..]),
        ("right", right, "DUMMY1", &["--pos", "800x150"]),
    ] {
        xrandr(&[&["--newmode", mode][..], &clock].concat())?;
        xrandr(&["--addmode", output, mode])?;
        xrandr(&[&["--output", output, "--mode", mode][..], place].concat())?;
    }
    Some(xorg)
}

#[test]
fn the_picture_lies_on_the_right_one_of_two_monitors() {
    let Some(xorg) = two_monitors() else {
        eprintln!("SKIPPED: Xorg with its dummy driver does not start here");
        return;
    };
    let server = xorg.server.as_str();
    let monitors = list_monitors(Some(server)).unwrap();
    let names: Vec<String> = monitors.iter().map(ToString::to_string).collect();
    // 38.25 MHz over 1024 x 624 and 20 MHz over 816 x 417.
    assert_eq!(names, ["DUMMY0 (800 x 600, 60 Hz)", "DUMMY1 (640 x 400, 59 Hz)"]);
    let xrandr = |arguments: &[&str]| {
        let status = Command::new("xrandr").args(["--display", server]).args(arguments).status();
        assert!(status.unwrap().success());
    };
    let desk = Desk::new(server);
    // Of 256 levels, with the lower bytes as the server likes.
    let is_straight = || desk.blue("DUMMY1").iter().map(|v| v >> 8).eq(0..256);
    assert!(is_straight());
    // A night light changes no pixel, but it does the light.
    let night_light = || xrandr(&["--output", "DUMMY1", "--gamma", "1:0.9:0.6"]);
    night_light();
    let bent = desk.blue("DUMMY1");
    assert!(!is_straight());

    let dark = Pattern::Black.render(800, 600, None).unwrap();
    let mut display = open(server, Some("DUMMY1"));
    assert!(is_straight());
    for (name, image) in pictures(WIDTH, HEIGHT) {
        display.show(&image).unwrap();
        display.still_shows().unwrap();
        let screen = screenshot(server);
        assert_eq!(screen.wrong(&image, 800, 150), 0, "{name}: wrong pixels");
        assert_eq!(screen.wrong(&dark, 0, 0), 0, "{name}: pixels on the other monitor");
    }
    night_light();
    assert_eq!(display.still_shows().unwrap_err().kind(), DeviceErrorKind::Busy);
    assert!(is_straight());
    display.still_shows().unwrap();
    display.park().unwrap();
    // As it was before.
    assert_eq!(desk.blue("DUMMY1"), bent);

    let image = Pattern::White.render(WIDTH, HEIGHT, None).unwrap();
    display.show(&image).unwrap();
    // Unplugged, as far as a server can tell.
    xrandr(&["--output", "DUMMY1", "--off"]);
    assert_eq!(display.still_shows().unwrap_err().kind(), DeviceErrorKind::Disconnected);
    let error = display.show(&image).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    assert!(error.to_string().contains("DUMMY0 (800 x 600"), "{error}");
}
