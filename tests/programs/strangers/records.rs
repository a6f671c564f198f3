//! Further inputs of strangers: records that name their values, pages, rows with gaps, and bags of two publishers.

use std::fs;
use std::path::Path;

use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Quaternion, Transform, TransformStamped, Vector3, Wrench, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use ros2_messages::tf2_msgs::TFMessage;
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};

/// Forty readings each, as those of `super::make`.
pub(super) fn make(folder: &Path) {
    let write = |name: &str, text: &[u8]| fs::write(folder.join(name), text).unwrap();
    let rows = |row: &dyn Fn(u32, f64, f64, f64) -> String| -> String {
        (0..40).map(|i| row(i, f64::from(i) / 10.0, f64::from(i) * 0.02, f64::from(i) * 1e-4)).collect()
    };
    let plain = rows(&|_, t, d, f| format!("{t:.1},{d:.2},{f:.4}\n"));
    let head = "Time (s),Depth (mm),Load (N)\n";
    // values with their names
    let object = |t: f64, d: f64, f: f64| format!("{{\"time_s\": {t:.1}, \"depth_mm\": {d:.2}, \"load_n\": {f:.4}}}");
    let lines = rows(&|_, t, d, f| object(t, d, f) + "\n");
    write("lines.jsonl", lines.as_bytes());
    write("list.json", format!("[\n  {}\n]\n", lines.trim_end().replace('\n', ",\n  ")).as_bytes());
    let list = |k: usize| plain.lines().map(|line| line.split(',').nth(k).unwrap()).collect::<Vec<_>>().join(", ");
    let columns =
        format!("{{\n \"time_s\": [{}],\n \"depth_mm\": [{}],\n \"load_n\": [{}]\n}}\n", list(0), list(1), list(2));
    write("columns.json", columns.as_bytes());
    write("killed.jsonl", lines.trim_end().trim_end_matches("39}").as_bytes());
    write("nan.jsonl", lines.replace("0.0020}", "NaN}").as_bytes());
    let stamp = |i: u32| format!("{{\"stamp\": {{\"sec\": {}, \"nanosec\": {}}}}}", 7 + i / 10, i % 10 * 100_000_000);
    let topics = rows(&|i, _, d, f| {
        let header = stamp(i);
        format!(
            "{{\"topic\": \"/lvdt\", \"log_time\": 7, \"data\": {{\"header\": {header}, \"name\": [\"z\"], \"position\": [{d:.2}]}}}}\n\
             {{\"topic\": \"/cell\", \"log_time\": 7, \"data\": {{\"header\": {header}, \"wrench\": {{\"force\": {{\"x\": 0.0, \"y\": 0.0, \
             \"z\": {f:.4}}}}}}}}}\n"
        )
    });
    write("topics.jsonl", topics.as_bytes());
    let echo = rows(&|i, _, d, _| {
        let (s, ns) = (7 + i / 10, i % 10 * 100_000_000);
        format!(
            "header:\n  stamp:\n    sec: {s}\n    nanosec: {ns}\n  frame_id: ''\nname:\n- z\nposition:\n- {d:.2}\nvelocity: []\n---\n"
        )
    });
    write("echo.yaml", echo.as_bytes());
    write("plotter.txt", rows(&|_, t, d, f| format!("time_s:{t:.1},depth_mm:{d:.2},load_N:{f:.4}\n")).as_bytes());
    let monitor = rows(&|i, _, d, f| format!("10:15:{:02}.{}00 -> {d:.2}, {f:.4}\n", i / 10, i % 10));
    write("monitor.txt", format!("10:14:59.000 -> Depth (mm), Load (N)\n{monitor}").as_bytes());
    let millis = rows(&|i, _, d, f| format!("{},{:.4},{d:.2}\n", 100 * i, f / 9.806_65e-3));
    write("millis.csv", format!("millis,load_g,depth_mm\n{millis}").as_bytes());
    // workbooks of 2003
    let cell = |kind: &str, text: &str| format!("<Cell><Data ss:Type=\"{kind}\">{text}</Data></Cell>");
    let sheet_rows = rows(&|_, t, d, f| {
        let cells: String =
            [format!("{t:.1}"), format!("{d:.2}"), format!("{f:.4}")].iter().map(|n| cell("Number", n)).collect();
        format!("<Row>{cells}</Row>\n")
    });
    let names: String = ["Time (s)", "Depth (mm)", "Load (N)"].iter().map(|name| cell("String", name)).collect();
    let sheet = |name: &str, rows: &str| {
        format!("<Worksheet ss:Name=\"{name}\"><Table><Row>{names}</Row>{rows}</Table></Worksheet>")
    };
    let book = format!(
        "<?xml version=\"1.0\"?>\n<?mso-application progid=\"Excel.Sheet\"?>\n<Workbook \
         xmlns=\"urn:schemas-microsoft-com:office:spreadsheet\" xmlns:ss=\"urn:schemas-microsoft-com:office:spreadsheet\">\n\
         <Worksheet ss:Name=\"Notes\"><Table><Row>{}</Row></Table></Worksheet>{}{}</Workbook>",
        cell("String", "gel &amp; rig"),
        sheet("Gel 7", &sheet_rows),
        sheet("Gel 8", &sheet_rows),
    );
    write("book.xml", book.as_bytes());
    write("book.xls", book.as_bytes());
    write("samples.xml", b"<?xml version=\"1.0\"?>\n<rig><row t=\"0\" f=\"0.1\"/><row t=\"1\" f=\"0.2\"/></rig>\n");
    // pages, gaps and marks
    let (first, second) = plain.split_at(plain.find("2.0,").unwrap());
    write("pages.csv", format!("Gel 7, page 1\n{head}{first}\n\x0cGel 7, page 2\n{head}{second}").as_bytes());
    write("page_of_two_lost.csv", format!("{head}{first}\n{head}2.0,OVER,0.002\n{second}").as_bytes());
    let later = second.lines().map(|line| format!("10{line}\n")).collect::<String>();
    write("later.csv", format!("{head}{first}{head}{later}").as_bytes());
    let gaps = rows(&|i, t, d, f| {
        let f = if i % 2 == 0 { format!("{f:10.4}") } else { " ".repeat(10) };
        format!("{t:8.1}{d:10.2}{f}{:8.1}\n", 21.0)
    });
    write("gaps.txt", format!("  Time(s) Depth(mm)   Load(N) Temp(C)\n{gaps}").as_bytes());
    let one_gap = rows(&|i, t, d, f| match i {
        30 => format!("{t:.3} {d:.3} 21.0\n"),
        _ => format!("{t:.3} {d:.3} {f:.4} 21.0\n"),
    });
    let same_width = one_gap.replace(" 21.0\n", " 21.000\n").replace("0.600 ", "0.600  ");
    write("one_gap_of_one_width.txt", format!("Time(s) Depth(mm) Load(N) Temp(C)\n{same_width}").as_bytes());
    write("one_gap.txt", format!("Time(s) Depth(mm) Load(N) Temp(C)\n{one_gap}").as_bytes());
    for (name, mark) in [("nan.csv", "NaN"), ("na.csv", "#N/A"), ("dashes_for_none.csv", "--")] {
        let half = rows(&|i, t, d, f| {
            let f = if i % 2 == 0 { format!("{f:.4}") } else { mark.to_owned() };
            format!("{t:.1},{d:.2},{f}\n")
        });
        write(name, format!("{head}{half}").as_bytes());
    }
    write("one_nan.csv", format!("{head}{}", plain.replace("0.0020\n", "NaN\n")).as_bytes());
    let comma = rows(&|_, t, d, f| format!("{t:.1}|{d:.2}|{f:.4}\n").replace('.', ",").replace('|', ","));
    write("commas_twice.csv", format!("{head}{comma}").as_bytes());
    write("nul.csv", &[head.as_bytes(), first.as_bytes(), &[0; 512], second.as_bytes(), &[0; 512]].concat());
    write(
        "mojibake.csv",
        format!("Time (s.),Depth (Âµm),Load (N)\n{}", rows(&|_, t, d, f| format!("{t:.1},{:.1},{f:.4}\n", 1e3 * d)))
            .as_bytes(),
    );
    write("pointer.csv", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n");
    write("empty.csv", b"");
    write("packed.zip", b"PK\x03\x04\x14\0\0\0\x08\0gel_7.csv and more");
    let ids = rows(&|i, t, d, f| format!("row{i},{t:.1},{d:.2},{f:.4}\n"));
    write("row_names.csv", format!("Name,{head}{ids}").as_bytes());
    let set_back = |by: f64| -> String {
        let time = |i: u32| f64::from(i) / 10.0 - if i < 200 { 0.0 } else { by };
        (0..400).map(|i| format!("{:.2},{:.3},{:.5}\n", time(i), f64::from(i) * 2e-3, f64::from(i) * 1e-5)).collect()
    };
    write("set_back.csv", format!("{head}{}", set_back(2.05)).as_bytes());
    let press = |i: u32| {
        let t = f64::from(i) * 0.01;
        let d = if t < 3.0 { t - 0.5 } else { 5.5 - t };
        (t, d, if d > 0.0 { 0.3116 * d + 0.0117 * d * d } else { 0.0 })
    };
    let dropping = |motion: bool| -> String {
        let row = |i: u32| {
            let ((t, d, f), out) = (press(i), i.is_multiple_of(20));
            let (d, f) = (if out && motion { 0.0 } else { d }, if out && !motion { 0.0 } else { f });
            format!("{t:.2},{d:.4},{f:.5}\n")
        };
        (0..600).map(row).collect()
    };
    write("position_drops_out.csv", format!("{head}{}", dropping(true)).as_bytes());
    write("force_drops_out.csv", format!("{head}{}", dropping(false)).as_bytes());
    bags(folder);
}

/// Presses to 2.5 mm and out at 1 mm/s, 100 Hz.
fn bags(folder: &Path) {
    /// Readings of a press: time, depth and force, and how the stamps of a bag come of them.
    struct Press<'a> {
        other_depth: Option<&'a dyn Fn(f64) -> f64>,
        other_force: Option<&'a dyn Fn(f64) -> f64>,
        has_force: bool,
        stamp: &'a dyn Fn(f64) -> f64,
    }
    let plain = Press { other_depth: None, other_force: None, has_force: true, stamp: &|t| t };
    let write = |name: &str, press: &Press| {
        let mut writer = BagWriter::create(folder.join(name), WriterOptions::default()).unwrap();
        let joint = writer.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
        let cell = writer.add_topic::<WrenchStamped>("/measured_cf", &Qos::reliable(10)).unwrap();
        let start = 1_767_225_600.0;
        for i in 0..600 {
            let t = f64::from(i) * 0.01;
            let d = if t < 3.0 { t - 0.5 } else { 5.5 - t };
            let f = if d > 0.0 { 0.3116 * d + 0.0117 * d * d } else { 0.0 };
            let log = ((start + t) * 1e9) as u64;
            let header = |late: f64| Header {
                stamp: Time::from_nanos(((start + (press.stamp)(t) + late) * 1e9) as i64),
                frame_id: "sample".to_owned(),
            };
            let depth = |late: f64, d: f64| JointState {
                header: header(late),
                name: vec!["insertion".to_owned()],
                position: vec![1e-3 * d],
                ..JointState::default()
            };
            let force = |late: f64, f: f64| WrenchStamped {
                header: header(late),
                wrench: Wrench { force: Vector3 { x: 0.0, y: 0.0, z: f }, torque: Vector3::default() },
            };
            writer.write(joint, log, log, &depth(0.0, d)).unwrap();
            if let Some(other) = press.other_depth {
                writer.write(joint, log + 3, log + 3, &depth(0.003, other(d))).unwrap();
            }
            if press.has_force {
                writer.write(cell, log, log, &force(0.0, f)).unwrap();
            }
            if let Some(other) = press.other_force {
                writer.write(cell, log + 4, log + 4, &force(0.002, other(f))).unwrap();
            }
        }
        writer.finish().unwrap();
    };
    write("two_zeros", &Press { other_depth: Some(&|d| d + 0.5), ..plain });
    write("standing", &Press { other_depth: Some(&|_| 0.0), ..plain });
    write("two_alike", &Press { other_depth: Some(&|d| d), ..plain });
    write("two_cells", &Press { other_force: Some(&|f| 0.5 * f + 0.2), ..plain });
    write("hum", &Press { other_force: Some(&|f| f + 0.03), ..plain });
    write("no_force", &Press { has_force: false, ..plain });
    tree(&folder.join("tree"));
    write("clock_set_back", &Press { stamp: &|t| if t < 3.0 { t } else { t - 2.05 }, ..plain });
}

/// The same press in a tree of transforms.
fn tree(folder: &Path) {
    let mut writer = BagWriter::create(folder, WriterOptions::default()).unwrap();
    let tree = writer.add_topic::<TFMessage>("/tf", &Qos::reliable(100)).unwrap();
    let cell = writer.add_topic::<WrenchStamped>("/measured_cf", &Qos::reliable(10)).unwrap();
    for i in 0..600_u32 {
        let t = f64::from(i) * 0.01;
        let d = if t < 3.0 { t - 0.5 } else { 5.5 - t };
        let f = if d > 0.0 { 0.3116 * d + 0.0117 * d * d } else { 0.0 };
        let log = 1_767_225_600_000_000_000 + 10_000_000 * u64::from(i);
        let header = Header { stamp: Time::from_nanos(log as i64), frame_id: "sample".to_owned() };
        let part = |name: &str, z: f64| TransformStamped {
            header: header.clone(),
            child_frame_id: name.to_owned(),
            transform: Transform {
                translation: Vector3 { x: 0.0, y: 0.0, z },
                rotation: Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 },
            },
        };
        writer
            .write(tree, log, log, &TFMessage { transforms: vec![part("base", 0.3), part("tip", 0.017 - 1e-3 * d)] })
            .unwrap();
        let wrench = Wrench { force: Vector3 { x: 0.0, y: 0.0, z: f }, torque: Vector3::default() };
        writer.write(cell, log, log, &WrenchStamped { header, wrench }).unwrap();
    }
    writer.finish().unwrap();
}
