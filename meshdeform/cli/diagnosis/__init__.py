"""The checks of `meshdeform doctor`. They download nothing and leave nothing behind."""
