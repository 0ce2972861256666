"""The bus below everything else: a real vcan0, two sockets, the kernel's time stamps."""

import multiprocessing

import can


def echo(count, listens):
    with can.Bus("vcan0", interface="socketcan") as bus:
        listens.set()
        for _ in range(count):
            received = bus.recv(10.0)
            bus.send(can.Message(arbitration_id=0x182, data=received.data, is_extended_id=False))


def test_frames_go_to_another_process_and_back():
    with can.Bus("vcan0", interface="socketcan") as bus:
        fork = multiprocessing.get_context("fork")
        listens = fork.Event()
        peer = fork.Process(target=echo, args=(100, listens))
        peer.start()
        assert listens.wait(60.0)
        for i in range(100):
            bus.send(can.Message(arbitration_id=0x181, data=[i], is_extended_id=False))
            answer = bus.recv(10.0)
            assert (answer.arbitration_id, bytes(answer.data)) == (0x182, bytes([i]))
        peer.join(10.0)
        assert peer.exitcode == 0
