use super::super::picture::{Overlay, Picture};
use super::super::state::{Event, Pose, Run, State, Thruster};
use super::*;
use hydroline_core::frame::{
    Frame, FrameMeta, GreyRule, LossBefore, PixelFormat, StampClock, StampSource,
};
use hydroline_log::messages::pb;
use hydroline_log::messages::{CompressedImage, ImageAnnotations, PoseInFrame, VehicleMotion};
use proptest::prelude::*;
use prost::Message;

fn number(channel: Channel) -> u32 {
    let place = Channel::ALL.iter().position(|c| *c == channel);
    place.unwrap() as u32 + 1
}

fn looking_at(channels: &[Channel]) -> Viewer {
    let mut viewer = Viewer::default();
    for channel in channels {
        let n = number(*channel);
        let text = format!(
            r#"{{"op":"subscribe","subscriptions":[{{"id":{},"channelId":{n}}}]}}"#,
            100 + n
        );
        assert_eq!(viewer.hear(&text), None);
    }
    viewer
}

/// Subscription, time and payload of a message, as a viewer reads it.
fn read(frame: &[u8]) -> (u32, u64, &[u8]) {
    assert_eq!(frame[0], 1);
    let id = u32::from_le_bytes(frame[1..5].try_into().unwrap());
    let at_ns = u64::from_le_bytes(frame[5..13].try_into().unwrap());
    (id, at_ns, &frame[13..])
}

#[test]
fn the_greeting_names_every_channel_with_its_schema() {
    let [info, advertised] = greeting("lshpi", "7");
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(
        info,
        json!({"op": "serverInfo", "name": "lshpi", "capabilities": [], "sessionId": "7"})
    );
    let advertised: serde_json::Value = serde_json::from_str(&advertised).unwrap();
    let channels = advertised["channels"].as_array().unwrap();
    assert_eq!(channels.len(), Channel::ALL.len());
    for (i, (sent, channel)) in channels.iter().zip(Channel::ALL).enumerate() {
        assert_eq!(sent["id"], i + 1);
        assert_eq!(sent["topic"], channel.topic());
        if let Channel::Log(topic) = channel {
            assert_eq!(sent["schemaName"], topic.schema_name());
            let schema = BASE64.decode(sent["schema"].as_str().unwrap().as_bytes());
            assert_eq!(schema.unwrap(), topic.schema().data);
        }
    }
}

#[test]
fn a_viewer_gets_what_it_has_subscribed_to_until_it_takes_it_back() {
    let motion = Channel::Log(Topic::Motion);
    let mut viewer = looking_at(&[motion]);
    let id = 100 + number(motion);
    let frames = viewer.frames(motion, 9, b"abc");
    assert_eq!(frames.len(), 1);
    assert_eq!(read(&frames[0]), (id, 9, &b"abc"[..]));
    assert!(viewer.frames(Channel::State, 9, b"abc").is_empty());
    assert!(!viewer.wants(Channel::is_picture));
    let back = format!(r#"{{"op":"unsubscribe","subscriptionIds":[{id}]}}"#);
    assert_eq!(viewer.hear(&back), None);
    assert!(viewer.frames(motion, 9, b"abc").is_empty());
}

#[test]
fn what_is_no_looking_is_answered_and_changes_nothing() {
    let mut viewer = Viewer::default();
    for text in [
        "",
        "{}",
        r#"{"op":"setParameters","parameters":[]}"#,
        r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":0}]}"#,
        r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]}"#,
        r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}"#,
    ] {
        let answer = viewer.hear(text).unwrap();
        let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
        assert_eq!(answer["op"], "status", "{text}");
        assert!(!viewer.wants(|_| true), "{text}");
    }
    let many: Vec<String> = (0..1000)
        .map(|id| format!(r#"{{"id":{id},"channelId":1}}"#))
        .collect();
    let many = format!(
        r#"{{"op":"subscribe","subscriptions":[{}]}}"#,
        many.join(",")
    );
    assert!(viewer.hear(&many).unwrap().contains("more than 64"));
    assert_eq!(viewer.frames(Channel::ALL[0], 0, b"").len(), 64);
}

#[test]
fn the_newest_protocol_of_ours_is_taken() {
    assert_eq!(
        protocol("foxglove.sdk.v1.1, foxglove.sdk.v1"),
        Some("foxglove.sdk.v1")
    );
    assert_eq!(
        protocol("foxglove.websocket.v1"),
        Some("foxglove.websocket.v1")
    );
    assert_eq!(protocol("foxglove.sdk.v1.1"), None);
    assert_eq!(protocol(""), None);
}

fn state(x_m: f64, events: usize) -> State {
    let measured = std::array::from_fn(|i| Some((if i == 0 { x_m } else { 0.1 * i as f64 }, 1e-4)));
    let event = |k: usize| Event {
        at_s: k as f64,
        severity: "warning",
        kind: "camera.lost".to_owned(),
        message: format!("event {k}"),
    };
    State {
        pose: Some(Pose::new("fitted", 100.0 + x_m, 0.0, measured, None)),
        run: Run {
            step: 3,
            ..Run::default()
        },
        thrusters: vec![
            Thruster {
                name: "bow".to_owned(),
                thrust_n: Some(2.5),
                pulse_us: Some(1560.0),
                echo_us: Some(1559.0),
                ..Thruster::default()
            },
            Thruster {
                name: "stern".to_owned(),
                ..Thruster::default()
            },
        ],
        events: (0..events).map(event).collect(),
        ..State::default()
    }
}

#[test]
fn a_state_is_sent_as_the_logs_messages_each_pose_and_event_once() {
    let of = |topic: Topic| 100 + number(Channel::Log(topic));
    let viewer = looking_at(&Channel::ALL);
    let mut sent = Sent::default();
    let first = sent.of_state(&viewer, &state(0.25, 2), 5);
    let payloads = |frames: &[Bytes], topic: Topic| -> Vec<Vec<u8>> {
        let read = frames.iter().map(|f| read(f));
        read.filter(|(id, _, _)| *id == of(topic))
            .map(|(_, _, data)| data.to_vec())
            .collect()
    };
    let motion = payloads(&first, Topic::Motion);
    let motion = VehicleMotion::decode(motion[0].as_slice()).unwrap();
    assert_eq!((motion.x_m, motion.psi_rad), (Some(0.25), Some(0.5)));
    assert_eq!(motion.timestamp.unwrap().seconds, 100);
    let pose = PoseInFrame::decode(payloads(&first, Topic::Pose)[0].as_slice()).unwrap();
    assert_eq!(pose.pose.unwrap().position.unwrap().x, 0.25);
    let commands = payloads(&first, Topic::Command);
    assert_eq!(commands.len(), 1, "nothing was sent to the other");
    let command = pb::ThrusterCommand::decode(commands[0].as_slice()).unwrap();
    assert_eq!((command.thruster.as_str(), command.thrust_n), ("bow", 2.5));
    assert_eq!(command.plan_step, 3);
    let echo = pb::ThrusterEcho::decode(payloads(&first, Topic::Echo)[0].as_slice()).unwrap();
    assert_eq!(echo.pulse_us, 1559.0);
    let events = payloads(&first, Topic::Event);
    let event = pb::Event::decode(events[1].as_slice()).unwrap();
    assert_eq!((events.len(), event.message.as_str()), (2, "event 1"));
    assert_eq!(event.severity(), pb::event::Severity::Warning);
    // The same pose again, and one event more.
    let second = sent.of_state(&viewer, &state(0.25, 3), 6);
    assert!(payloads(&second, Topic::Motion).is_empty());
    let events = payloads(&second, Topic::Event);
    let event = pb::Event::decode(events[0].as_slice()).unwrap();
    assert_eq!((events.len(), event.message.as_str()), (1, "event 2"));
    let third = sent.of_state(&viewer, &state(0.3, 3), 7);
    assert_eq!(payloads(&third, Topic::Motion).len(), 1);
    assert!(payloads(&third, Topic::Event).is_empty());
}

#[test]
fn a_picture_is_sent_with_its_lines_where_they_are_in_the_image_that_is_sent() {
    let picture = Picture {
        frame: Frame {
            format: PixelFormat::Grey,
            width_px: 2000,
            height_px: 2,
            stride_bytes: 2000,
            data: Bytes::from(vec![0; 4000]),
            meta: FrameMeta {
                sequence: 1,
                driver_stamp_ns: 0,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: 0,
                mid_exposure_ns: 4_000_000_000,
                exposure_s: 0.0,
                fault: None,
                lost_before: LossBefore::default(),
            },
        },
        rule: GreyRule::default(),
        overlay: Overlay {
            stripe_px: vec![[0.0, 1.5]],
            outline_px: vec![Some([0.0, 0.0]), Some([9.0, 0.0]), None, Some([5.0, 5.0])],
            ..Overlay::default()
        },
    };
    let channels = [
        Channel::Log(Topic::CompressedImage),
        Channel::Log(Topic::Annotations),
    ];
    let viewer = looking_at(&channels);
    assert!(viewer.wants(Channel::is_picture));
    let frames = of_picture(&viewer, &picture, Bytes::from_static(b"jpeg"), 0.5, 8);
    let image = CompressedImage::decode(read(&frames[0]).2).unwrap();
    assert_eq!(
        (image.format.as_str(), &image.data[..]),
        ("jpeg", &b"jpeg"[..])
    );
    assert_eq!(image.timestamp.unwrap().sec(), 4);
    let drawn = ImageAnnotations::decode(read(&frames[1]).2).unwrap();
    // Foxglove counts from the corner: the centre of pixel 0 is at .5, halved at .25.
    let stripe = &drawn.points[0].points[0];
    assert_eq!((stripe.x, stripe.y), (0.25, 1.0));
    // A line of one point is none.
    assert_eq!(drawn.points.len(), 2);
    assert_eq!(drawn.points[1].points[1].x, 4.75);
    // A frame that does not decode has no image, but its lines.
    assert_eq!(of_picture(&viewer, &picture, Bytes::new(), 1.0, 8).len(), 1);
}

#[test]
fn the_layout_draws_every_thruster_and_shows_channels_that_are_there() {
    let text = layout(&["bow", "st\"ern"]);
    let layout: serde_json::Value = serde_json::from_str(&text).unwrap();
    let paths = layout["configById"]["Plot!thrust"]["paths"].as_array();
    assert_eq!(
        paths.unwrap()[1]["value"],
        r#"/thruster/command{thruster=="st\"ern"}.thrust_n"#
    );
    let panels = layout["configById"].as_object().unwrap();
    for name in panels.keys() {
        assert!(
            layout["layout"].to_string().contains(name),
            "{name} is shown"
        );
    }
    let known = |topic: &str| Channel::ALL.iter().any(|c| c.topic() == topic);
    let values = panels.values().flat_map(|p| {
        let paths = p["paths"].as_array().cloned().unwrap_or_default();
        let of = paths.into_iter().map(|p| p["value"].clone());
        of.chain([p["topicPath"].clone(), p["imageMode"]["imageTopic"].clone()])
    });
    for path in values.filter_map(|v| v.as_str().map(str::to_owned)) {
        let topic = path.split(['.', '{']).next().unwrap();
        assert!(known(topic), "{path}");
    }
}

proptest! {
    #[test]
    fn whatever_a_viewer_says_it_is_heard_and_answered(text in "\\PC{0,200}") {
        let mut viewer = Viewer::default();
        viewer.hear(&text);
        prop_assert!(!viewer.wants(|_| true));
    }

    #[test]
    fn any_subscription_is_to_a_channel_that_is_there(id: u32, channel: u64) {
        let mut viewer = Viewer::default();
        let answer = viewer.hear(&format!(
            r#"{{"op":"subscribe","subscriptions":[{{"id":{id},"channelId":{channel}}}]}}"#
        ));
        let there = (1..=Channel::ALL.len() as u64).contains(&channel);
        prop_assert_eq!((answer.is_none(), viewer.wants(|_| true)), (there, there));
    }
}
