# Every target does its own set-up (.venv and system libraries); a second run reuses it.
# ARGS go to the command: make test ARGS="tests/geometry -x"

.PHONY: demo test test-pyside6 lint bench pictures setup clean

test: setup
	@tools/test.sh $(ARGS)

test-pyside6: setup
	@tools/test_pyside6.sh $(ARGS)

demo: setup
	@tools/demo.sh $(ARGS)

lint: setup
	@tools/lint.sh

bench: setup
	@tools/bench.sh $(ARGS)

pictures: setup
	@tools/pictures.sh $(ARGS)

setup:
	@tools/setup.sh

clean:
	@tools/clean.sh
