# The injectors themselves, seen by the small readers: no daemon involved.
. /lib.sh
vivid_on || exit 1
v4l_watch /dev/video0 GREY 720 576 9 >/out/vivid.txt &
watch=$!
sleep 1; at vivid_error; vivid_control inject_v4l2_buf_flag_error=1
sleep 0.6; at vivid_fatal; vivid_control inject_fatal_streaming_error=1
sleep 1; at vivid_freeze; vivid_control percentage_of_dropped_buffers=100
sleep 1.2; vivid_control percentage_of_dropped_buffers=0
sleep 0.8; at vivid_unbind; echo vivid.0 >/sys/bus/platform/drivers/vivid/unbind
sleep 0.5; echo vivid.0 >/sys/bus/platform/drivers/vivid/bind
wait $watch; rmmod vivid || exit 1

uvc_on 30 /out/uvc.txt || exit 1
v4l_watch /dev/video0 MJPG 640 480 12 >/out/watch.txt &
watch=$!
for fault in e t d s; do sleep 0.7; uvc_fault $fault; done
sleep 3; uvc_fault h
sleep 2.5; at uvc_unplug; uvc_fault u
sleep 0.5; uvc_on 30 /out/uvc.txt; at uvc_node
wait $watch

serial_on || exit 1
serial_watch /dev/ttyUSB0 7.5 >/out/serial.txt &
watch=$!
sleep 1; at serial_unplug; mark '{"adapter":"unplug"}'; sleep 0.5; mark '{"adapter":"plug"}'
wait_for 5 test -e /dev/ttyUSB0; at serial_node
sleep 1.5; at controller_kill; mark '{"controller":"kill"}'; sleep 0.5; mark '{"controller":"start"}'
wait $watch

modprobe v4l2loopback video_nr=10 card_label=hil exclusive_caps=1 max_buffers=8
head -c 20736000 /dev/urandom >/work/frames.raw
loopback_feed /dev/video10 720 576 25 /work/frames.raw /out/feed.txt &
wait_for 5 grep -q ready /out/feed.txt || exit 1
( sleep 0.5; echo -n g >/tmp/feed ) &
v4l_watch /dev/video10 GREY 720 576 3 >/out/loopback.txt
echo -n q >/tmp/feed
exit 0
