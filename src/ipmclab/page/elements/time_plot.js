// The plot of plot.js as an element of NiceGUI.
export default {
  template: "<div></div>",
  props: { options: Object },
  mounted() {
    this.stack = new window.LabPlot.Stack(this.$el, this.options);
  },
  unmounted() {
    this.stack.destroy();
  },
  methods: {
    show(told) {
      this.stack.change(told);
    },
  },
};
