//! One node of ROS 2: a peer that speaks the convention, connected as a program of ROS 2 is, takes and gives messages through
//! a router that comes late, goes and comes again.

use std::sync::{Arc, Mutex};

use stillpoint_remote::{Ros2, Ros2Message, Ros2Settings};
use stillpoint_ros2::{Attachment, TopicName, gid, key, rihs01};
use zenoh::{Config, Session, Wait};

use crate::common::{eventually, two_ports};

const IMAGE: (&str, &str) = ("sensor_msgs/msg/Image", "uint32 height\nuint8[] data\n");
const POSE: (&str, &str) = ("geometry_msgs/msg/PoseStamped", "float64 x\n");

fn session(mode: &str, part: &str, port: u16) -> Session {
    let config = format!(
        "{{ mode: '{mode}', {part}: {{ endpoints: ['tcp/127.0.0.1:{port}'] }}, scouting: {{ multicast: {{ enabled: false }} }} }}"
    );
    zenoh::open(Config::from_json5(&config).unwrap()).wait().unwrap()
}

/// As `rmw_zenohd` and a program of ROS 2 are connected.
fn router(port: u16) -> Session {
    session("router", "listen", port)
}

/// Attachment, whether of the type, and bytes of a message.
type Came = Arc<Mutex<Vec<(Vec<u8>, bool, Vec<u8>)>>>;

fn texts(node: &Ros2, all: &mut String) {
    node.events().into_iter().for_each(|event| *all += &format!("{}\n", event.text));
}

#[test]
fn a_node_comes_before_its_router_and_exchanges_messages_also_after_its_restart() {
    let port = two_ports();
    let node = Ros2::open(Ros2Settings {
        connect: format!("tcp/127.0.0.1:{port}"),
        domain: 7,
        node: "head".to_owned(),
        longest: 1 << 20,
    })
    .unwrap();
    let poses = node.publisher("poses", "/head_pose", POSE).unwrap();
    node.repeat("/tf_static", POSE, b"frames".to_vec()).unwrap();
    let came = Came::default();
    let retained = came.clone();
    let take = move |message: &Ros2Message<'_>| {
        let bytes = message.payload.to_bytes().into_owned();
        retained.lock().unwrap().push((message.attachment.to_vec(), message.is_of_type, bytes));
    };
    node.take("/camera/image", IMAGE, Arc::new(take)).unwrap();
    poses.send(Some(vec![0]));
    let mut reported = String::new();
    eventually("the missing router is told", || {
        texts(&node, &mut reported);
        reported.contains(&format!("no router is at tcp/127.0.0.1:{port}"))
    });
    let middle = router(port);
    let peer = session("peer", "connect", port);
    let tokens = Arc::new(Mutex::new(Vec::new()));
    let of_tokens = tokens.clone();
    let _tokens = peer
        .liveliness()
        .declare_subscriber("@ros2_lv/7/**")
        .history(true)
        .callback(move |token| of_tokens.lock().unwrap().push(token.key_expr().to_string()))
        .wait()
        .unwrap();
    let (sent, frames) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(0)));
    let hash = |schema: (&str, &str)| rihs01(schema.0, schema.1).unwrap();
    let of = |topic: &str, schema: (&str, &str)| {
        key(7, &TopicName::parse(topic).unwrap(), schema.0, &hash(schema))
    };
    let of_sent = sent.clone();
    let _poses = peer
        .declare_subscriber(of("/head_pose", POSE))
        .callback(move |s| {
            let attachment = s.attachment().unwrap().to_bytes().into_owned();
            of_sent.lock().unwrap().push((attachment, s.payload().to_bytes().into_owned()));
        })
        .wait()
        .unwrap();
    let rviz = format!(
        "@ros2_lv/7/{}/0/4/MS/%/%/rviz/%head_pose/geometry_msgs::msg::dds_::PoseStamped_/{}/::,10:,:,:,,",
        peer.zid(),
        hash(POSE)
    );
    let _rviz = peer.liveliness().declare_token(rviz).wait().unwrap();
    let of_frames = frames.clone();
    let _frames = peer
        .declare_subscriber(of("/tf_static", POSE))
        .callback(move |_| *of_frames.lock().unwrap() += 1)
        .wait()
        .unwrap();
    let mut number = 0;
    eventually("a pose arrives", || {
        number += 1;
        poses.send(Some(vec![number]));
        !sent.lock().unwrap().is_empty()
    });
    eventually("static frames arrive", || *frames.lock().unwrap() > 0);
    let (attachment, body) = sent.lock().unwrap()[0].clone();
    let attachment = Attachment::parse(&attachment).unwrap();
    assert_eq!(attachment.sequence, 1);
    assert!(body[0] > 0, "what nobody heard is not sent later");
    // The sender is the one whose token is there, and the node has one.
    eventually("four tokens", || tokens.lock().unwrap().len() >= 4);
    let tokens = tokens.lock().unwrap().clone();
    assert!(tokens.iter().any(|t| t.contains("/0/0/NN/%/%/head")), "{tokens:?}");
    let own = tokens.iter().find(|t| t.contains("/MP/%/%/head/%head_pose/")).unwrap();
    assert_eq!(gid(own), attachment.gid);
    assert!(tokens.iter().any(|t| t.contains("/MS/%/%/head/%camera%image/sensor_msgs::msg::dds_::Image_/")));

    // Messages of the type, of another one, and of a program without hashes.
    let give = |topic: &str, body: &[u8]| {
        peer.put(topic.to_owned(), body.to_vec()).attachment(&[7_u8; 33][..]).wait().unwrap();
    };
    give(&of("/camera/image", IMAGE), b"image");
    give(&of("/camera/image", POSE), b"pose");
    give("7/camera/image/sensor_msgs::msg::dds_::Image_/TypeHashNotSupported", b"humble");
    give(&of("/camera/image/raw", IMAGE), b"elsewhere");
    eventually("three messages", || came.lock().unwrap().len() >= 3);
    let taken: Vec<(bool, Vec<u8>)> =
        came.lock().unwrap().iter().map(|(_, is_of_type, bytes)| (*is_of_type, bytes.clone())).collect();
    assert_eq!(taken, [(true, b"image".to_vec()), (false, b"pose".to_vec()), (true, b"humble".to_vec())]);
    assert_eq!(came.lock().unwrap()[0].0, [7; 33]);

    // The router goes and comes again.
    middle.close().wait().unwrap();
    eventually("the lost router is told", || {
        texts(&node, &mut reported);
        reported.contains("is gone")
    });
    let _middle = router(port);
    came.lock().unwrap().clear();
    eventually("messages pass again", || {
        give(&of("/camera/image", IMAGE), b"again");
        !came.lock().unwrap().is_empty()
    });
    let counts = node.sent()["poses"];
    assert_eq!(counts.offered, counts.replaced + counts.unheard + counts.put + counts.waiting);
    assert!(counts.unheard > 0 && counts.received > 0, "{counts:?}");
    texts(&node, &mut reported);
    assert!(
        reported.contains("the node /head is connected") && reported.contains("/rviz takes /head_pose"),
        "{reported}"
    );
}

#[test]
fn an_endpoint_or_a_topic_that_is_none_is_refused() {
    let settings = |connect: &str| Ros2Settings {
        connect: connect.to_owned(),
        domain: 0,
        node: "head".to_owned(),
        longest: 0,
    };
    for wrong in ["udp/127.0.0.1:7447", "tcp/127.0.0.1", "tls/127.0.0.1:7447"] {
        let refused = Ros2::open(settings(wrong)).err().unwrap().to_string();
        assert!(refused.contains(wrong), "{refused}");
    }
    let node = Ros2::open(settings("tcp/127.0.0.1:9")).unwrap();
    let refused = node.publisher("a", "pose", POSE).err().unwrap().to_string();
    assert!(refused.contains("`pose`") && refused.contains("does not begin with `/`"), "{refused}");
}
